#!/usr/bin/env python3
"""Whether ROS 2's own tools find everything as they expect it: one line for each check.

    scripts/check_ros2.sh

It needs the real `ros2` command, from apt or from an environment that has ros2cli, launch and launch_ros.
Nodes run in a ROS domain of their own, on this machine alone.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util.recording.reader import Recording

EXECUTABLES = {
    "trunk_sim": ("simulator", "disturbance"),
    "trunk_control": ("pid", "fuzzy_pid", "lqr", "computed_torque"),
    "trunk_msgs_util": ("recorder",),
}
PATIENCE_S = 60.0  # for what a tool has to discover first
LAUNCH = ("launch", "trunk_experiments", "trunk.launch.py")
results: list[bool] = []


def check(what: str, good: object, detail: str = "") -> None:
    """Print a line and keep the result."""
    results.append(bool(good))
    line = "" if good else " ".join(detail.split())[-300:]
    print(f"{'ok  ' if good else 'FAIL'}  {what}{': ' if line else ''}{line}", flush=True)


def ros2(*words: object) -> subprocess.CompletedProcess[str]:
    """Run `ros2` to its end."""
    return subprocess.run(
        ["ros2", *map(str, words)], text=True, capture_output=True, timeout=300, check=False
    )


def says(what: str, words: tuple[object, ...], *patterns: str, code: int = 0) -> str:
    """Check that a command ends with a code and prints what these patterns match; return its output."""
    done = ros2(*words)
    text = done.stdout + done.stderr
    missing = [pattern for pattern in patterns if not re.search(pattern, text)]
    good = done.returncode == code and not missing and "Traceback" not in text
    check(what, good, f"code {done.returncode}, without {missing}: {text}")
    return text


def until(condition: Callable[[], object]) -> bool:
    """Wait until a condition holds, or patience is at its end."""
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


def check_packages() -> None:
    packages = listed("pkg", "list")
    for package, executables in EXECUTABLES.items():
        check(f"ros2 pkg list has {package}", package in packages)
        found = listed("pkg", "executables", package)
        check(f"ros2 pkg executables {package}", set(executables) <= found, str(found))
    says("ros2 interface show", ("interface", "show", "sensor_msgs/msg/JointState"), "effort")


def check_runs() -> None:
    for package, executables in EXECUTABLES.items():
        for name in executables:
            with running(*node(package, name)) as process:
                there = until(lambda name=name: f"/{name}" in listed("node", "list"))
                check(f"ros2 run {package} {name}: in ros2 node list", there)
                os.killpg(process.pid, signal.SIGINT)
                output, _ = process.communicate(timeout=120)
                check(f"{name} ends on Ctrl-C with code 0", process.returncode == 0, output)


def check_topics(folder: Path) -> None:
    recording = folder / "topics.mcap"
    with (
        running(*node("trunk_msgs_util", "recorder", f"output:={recording}")),
        running(*node("trunk_control", "pid", "reference.profile:=topic")),
        running(*node("trunk_sim", "simulator", "duration:=0.0", "publish_clock:=true")),
    ):
        until(lambda: {"/clock", "/reference"} <= listed("topic", "list"))
        shown, hidden = listed("topic", "list"), listed("topic", "list", "--include-hidden-topics")
        for topic in (
            "/joint_states",
            "/ground_truth/joint_states",
            "/effort_command",
            "/reference",
        ):
            check(f"ros2 topic list has {topic}", topic in shown, str(shown))
        check("the recorder's own topics are hidden", not any("/_" in name for name in shown))
        check("... and there", "/_joint_states" in hidden, str(hidden))
        says("ros2 topic type", ("topic", "type", "/joint_states"), "sensor_msgs/msg/JointState")
        info = says(
            "ros2 topic info -v", ("topic", "info", "-v", "/joint_states"), "Node name: sim"
        )
        check("live topics are volatile", "TRANSIENT_LOCAL" not in info, info)
        heard = [ros2("topic", "echo", "--once", "/joint_states").stdout for _ in range(2)]
        stamps = [yaml.safe_load(text.split("---")[0])["header"]["stamp"] for text in heard]
        seconds = [stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in stamps]
        check("ros2 topic echo shows the present", 0.0 < seconds[0] < seconds[1], str(seconds))
        message = "{name: [trunk], position: [0.1]}"
        kind = "sensor_msgs/msg/JointState"
        words = ("topic", "pub", "--times", 3, "-w", 2, "/reference", kind, message)
        says("ros2 topic pub to /reference", words, "publishing #3")
        says("ros2 node info", ("node", "info", "/simulator"), "/effort_command", "/joint_states")
        check_parameters(folder)
        check_services()
    found = Recording.open(recording)
    check("what ros2 topic pub sent is recorded", found.topics["/reference"].count == 3)
    check("the recording is complete", found.complete, str(found.warnings))
    verdict = verify(found)
    check("... and verified", verdict.exit_code == VERIFIED, str(verdict.reasons))


def check_parameters(folder: Path) -> None:
    says("ros2 param list", ("param", "list", "/pid"), r"gains\.p", r"reference\.profile")
    says("ros2 param get", ("param", "get", "/pid", "gains.p"), r"Double value is: 60\.0")
    says("ros2 param describe", ("param", "describe", "/pid", "gains.p"), "Proportional gain")
    says("ros2 param set", ("param", "set", "/pid", "gains.p", "61.0"), "successful")
    says("... out of range", ("param", "set", "/pid", "gains.p", ".nan"), "gains.p", code=0)
    says("... fixed at start", ("param", "set", "/pid", "joint", "hip"), "joint", code=0)
    for name in ("pid", "simulator", "recorder"):
        dump = folder / f"{name}.yaml"
        dump.write_text(says(f"ros2 param dump /{name}", ("param", "dump", f"/{name}"), name))
        text = says(f"ros2 param load /{name}, unchanged", ("param", "load", f"/{name}", dump))
        check("... refuses nothing", "fail" not in text.lower(), text)
    says("the reference lets go", ("param", "set", "/pid", "reference.profile", "constant"), "succ")
    (folder / "pid.yaml").write_text(ros2("param", "dump", "/pid").stdout)
    dumped = ["trunk", "simulate", "fig8", "--controller", "pid", "--params", folder / "pid.yaml"]
    done = subprocess.run(
        [*map(str, dumped), "--duration", "0.1", "-o", str(folder / "dumped.mcap")],
        capture_output=True,
        text=True,
        check=False,
    )
    check("trunk simulate --params takes the dump", done.returncode == 0, done.stderr)


def check_services() -> None:
    says("ros2 service list", ("service", "list"), "/simulator/reset", "/pid/reset")
    says("ros2 service type", ("service", "type", "/simulator/pause"), "std_srvs/srv/SetBool")
    for name, value in (("pause", "{data: true}"), ("pause", "{data: false}"), ("reset", "{}")):
        kind = "std_srvs/srv/" + ("SetBool" if name == "pause" else "Trigger")
        words = ("service", "call", f"/simulator/{name}", kind, value)
        says(f"ros2 service call /simulator/{name} {value}", words, "success=True")


def check_lifecycle() -> None:
    with running(*node("trunk_control", "pid", "autostart:=false")):
        until(lambda: "/pid" in listed("lifecycle", "nodes"))
        says("ros2 lifecycle nodes", ("lifecycle", "nodes"), "/pid")
        says("ros2 lifecycle get", ("lifecycle", "get", "/pid"), "unconfigured")
        for label in ("configure", "activate", "deactivate", "cleanup"):
            words = ("lifecycle", "set", "/pid", label)
            says(f"ros2 lifecycle set /pid {label}", words, "Transitioning successful")
        says("a transition that there is not", ("lifecycle", "set", "/pid", "activate"), code=1)


def check_launch(folder: Path) -> None:
    says("ros2 launch --show-args", (*LAUNCH, "--show-args"), "'scenario'", "'lockstep'")
    run = folder / "launched"
    given = ("scenario:=demo", "duration:=1.0", "lockstep:=true")
    text = says("ros2 launch, lock-step", (*LAUNCH, *given, f"output:={run}"), "the run is over")
    check("... gives our reason at its end", "was required" not in text, text)
    verdict = verify(Recording.open(run))  # the folder, as a bag
    check("... its folder is a bag, and verified", verdict.exit_code == VERIFIED, str(verdict))
    bad = (*LAUNCH, "scenario:=nowhere", f"output:={folder / 'bad'}")
    says("ros2 launch of an unknown scenario", bad, "nowhere", code=1)
    if "rviz2" not in listed("pkg", "list"):
        words = (*LAUNCH, "rviz:=true", f"output:={folder / 'rviz'}")
        says("rviz:=true without RViz is refused", words, "rviz2", code=1)
        check("... and leaves no folder", not (folder / "rviz").exists())
    first = (*LAUNCH, "scenario:=demo", "duration:=3600.0", f"output:={folder / 'first'}")
    with running(*first) as process:
        until(lambda: "/simulator" in listed("node", "list"))
        second = ros2(*LAUNCH, "scenario:=demo", "duration:=1.0", f"output:={folder / 'second'}")
        check("a second launch in the same namespace is refused", second.returncode, second.stdout)
        process.wait(120)


def check_swap(folder: Path) -> None:
    run = folder / "swapped"
    words = (*LAUNCH, "scenario:=demo", "controller:=pid", "duration:=60.0", f"output:={run}")
    with running(*words) as launched:
        until(lambda: "/pid" in listed("lifecycle", "nodes"))
        with running(*node("trunk_control", "fuzzy_pid", "autostart:=false")):
            until(lambda: "/fuzzy_pid" in listed("lifecycle", "nodes"))
            for name, label in (
                ("fuzzy_pid", "configure"),
                ("pid", "deactivate"),
                ("fuzzy_pid", "activate"),
                ("fuzzy_pid", "deactivate"),
                ("pid", "activate"),
            ):
                set_to = ("lifecycle", "set", f"/{name}", label)
                says(f"in a launched run: {name} {label}", set_to, "Transitioning successful")
        launched.communicate(timeout=300)
    verdict = verify(Recording.open(run / "run.mcap"))
    parts = {part.name: part.steps for part in verdict.parts}
    check("the swap by hand is verified", verdict.exit_code == VERIFIED, str(verdict.reasons))
    check(
        "... commands of both", min(parts.get(f"commands of {n}", 0) for n in ("pid", "fuzzy_pid"))
    )
    like = ["trunk", "simulate", "--like", str(run / "run.mcap"), "-o", str(folder / "like.mcap")]
    done = subprocess.run(like, capture_output=True, text=True, check=False)
    check("... and can be repeated (trunk simulate --like)", done.returncode == 0, done.stderr)


def main() -> int:
    if ros2("topic", "list", "--help").returncode:
        print("skipped: no real ros2 command here; source /opt/ros/jazzy/setup.bash first")
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        check_packages()
        check_runs()
        check_topics(folder)
        check_lifecycle()
        check_launch(folder)
        check_swap(folder)
    failed = results.count(False)
    print(f"{len(results)} checks, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
