"""A verb in a child of this process, under limits of memory and time; its parent has loaded the modules."""

import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

MEMORY = 2 << 30  # bytes of address space
SECONDS = 30  # of processor time: a busy machine must not make a verb fail
_HANGS = 20 * SECONDS  # of wall-clock time
TIME_OUT, TRACEBACK, NOISE, FINE = "time-out", "traceback", "noise", "fine"
_CODES = (0, 1, 2)
# What verbs import when they are called; a child then starts with it.
_LOADED = (
    *(
        f"trunk_experiments.commands.{name}"
        for name in (
            *("compare", "diff", "explain", "export", "info", "metrics"),
            *("plan", "plot", "recover", "report", "simulate", "sweep", "verify"),
        )
    ),
    "trunk_experiments.console.options",
    "trunk_evidence.recorded_run",
    "trunk_runs.offline_recording",
    "trunk_views.plots",
    "trunk_views.run_report",
    "trunk_views.run_report",
    "matplotlib.backends.backend_agg",
    "pyarrow.parquet",
)


class Outcome(NamedTuple):
    """What a verb did: the process's code, what it printed, how long it took, its peak of memory."""

    code: int
    out: str
    err: str
    seconds: float  # of the processor's time
    peak: int  # bytes

    @property
    def verdict(self) -> str:
        """One of `TIME_OUT`, `TRACEBACK`, `NOISE` (lines that are not ours on stderr) and `FINE`."""
        if self.code in (-signal.SIGALRM, -signal.SIGPROF):
            return TIME_OUT
        if self.code not in _CODES or "Traceback" in self.err:
            return TRACEBACK
        strange = [line for line in self.err.splitlines() if not _is_ours(line)]
        return NOISE if strange else FINE


def _is_ours(line: str) -> bool:
    return line.startswith("trunk: ") or not line.strip()


def load() -> None:
    """Import once what every child needs."""
    for name in _LOADED:
        import_module(name)


def run(
    arguments: Sequence[object], folder: Path, seconds: float = SECONDS, memory: int = MEMORY
) -> Outcome:
    """Run ``trunk`` with these arguments in a child of this process, within the limits."""

    def verb() -> None:
        sys.argv = ["trunk", *map(str, arguments)]
        import_module("trunk_experiments.cli").main()

    return call(verb, folder, seconds, memory)


def call(
    function: Callable[[], None], folder: Path, seconds: float = SECONDS, memory: int = MEMORY
) -> Outcome:
    """Call a function in a child of this process, within the limits."""
    out, err = folder / "out", folder / "err"
    child = os.fork()
    if child == 0:
        _child(function, out, err, seconds, memory)
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    texts = (path.read_text("utf-8", errors="replace") for path in (out, err))
    return Outcome(code, *texts, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024)


def _child(function: Callable[[], None], out: Path, err: Path, seconds: float, memory: int) -> None:
    code = 70
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number, path in ((1, out), (2, err)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        for one in (signal.SIGALRM, signal.SIGPROF):
            signal.signal(one, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        signal.setitimer(signal.ITIMER_REAL, _HANGS)
        try:
            function()
            code = 0
        except SystemExit as stop:
            if isinstance(stop.code, str):
                print(stop.code, file=sys.stderr)
            code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        except BaseException:  # what no user should see, a MemoryError included
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)
