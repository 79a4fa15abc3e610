"""Run ROS 2's own command and check what it says: one line for each check."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from trunk_core.errors import RecordingError
from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording

from ..finished import finished

PATIENCE_S = 60.0  # for what a tool has to discover first
results: list[bool] = []


def check(what: str, good: object, detail: str = "") -> None:
    """Print a line and keep the result."""
    results.append(bool(good))
    line = "" if good else " ".join(detail.split())[-300:]
    print(f"{'ok  ' if good else 'FAIL'}  {what}{': ' if line else ''}{line}", flush=True)


def ros2(*words: object) -> subprocess.CompletedProcess[str]:
    """Run `ros2` to its end."""
    return finished(["ros2", *map(str, words)], timeout=300)


def says(what: str, words: tuple[object, ...], *patterns: str, code: int = 0) -> str:
    """Check that a command ends with a code and prints what these patterns match; return its output."""
    done = ros2(*words)
    text = done.stdout + done.stderr
    missing = [pattern for pattern in patterns if not re.search(pattern, text)]
    good = done.returncode == code and not missing and "Traceback" not in text
    check(what, good, f"code {done.returncode}, without {missing}: {text}")
    return text


def check_verified(what: str, recording: Path) -> None:
    """Check that a file, or a folder as a bag, is verified."""
    try:
        verdict = verify(Recording.open(recording))
    except RecordingError as error:
        check(what, False, str(error))
    else:
        check(what, verdict.exit_code == VERIFIED, str(verdict))


@contextmanager
def daemon_of_ours() -> Iterator[None]:
    """End the daemon that `ros2` starts meanwhile; one already running is not ours, and stays."""
    was_there = "is running" in ros2("daemon", "status").stdout
    try:
        yield
    finally:
        if not was_there:
            ros2("daemon", "stop")


def until(condition: Callable[[], object]) -> bool:
    """Wait until a condition holds, or patience runs out."""
    end = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return bool(condition())


@contextmanager
def running(*words: object, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """Have `ros2` run something meanwhile; end it as Ctrl-C does."""
    process = subprocess.Popen(
        ["ros2", *map(str, words)],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, **environment},
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        process.communicate(timeout=120)


def listed(*words: str) -> set[str]:
    return set(ros2(*words).stdout.split())


def node(package: str, executable: str, *arguments: str) -> tuple[object, ...]:
    given = [word for argument in arguments for word in ("-p", argument)]
    return ("run", package, executable, "--ros-args", *given)
