"""Property tests try the same examples each time; HYPOTHESIS_PROFILE=default tries new ones.

No example has a time limit, and no test sets one: how long it takes is the machine's affair.

Of the cases marked ``one_in(N)``, a share runs each time: another one in each epoch, all of them in N epochs.
Of a file's cases marked ``virtual``, one runs in real processes each time; in a virtual one, all do
(tests/graph/virtual.py).
The epoch is TRUNK_EPOCH, else the number of commits. scripts/test.sh --all runs them all.

With TRUNK_BELOW, a package's tests, started in its folder, find the packages below it alone
(scripts/colcon_test.sh).

What was skipped, and how to get it, goes to the file TRUNK_SKIPPED, for the last line of scripts/test.sh;
what each test cost goes to the file TRUNK_DURATIONS. None is skipped for want of a tool that TRUNK_REQUIRE
names.

A test that hangs is ended after the `timeout` of pyproject.toml; browser tests, which may wait for something
that never comes, are ended sooner. These seconds grow longer on a busy machine.
"""

import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from time import monotonic
from types import FrameType
from typing import Any
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings

from trunk_core import PACKAGES

_PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("default", _PATIENT)
settings.register_profile("same", _PATIENT, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


class _Above:
    """Lets the packages above the one of the current folder be as if they were not installed."""

    names = PACKAGES[PACKAGES.index(Path.cwd().name) + 1 :] if "TRUNK_BELOW" in os.environ else ()

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name.partition(".")[0] in self.names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, _Above())

# A background job begins with SIGINT ignored, and so would all that it starts: some of those that were forked
# lost a signal that came early, and no shell can handle one that it began without.
signal.signal(signal.SIGINT, signal.default_int_handler)

_GRAPH_TESTS = Path(__file__).parent / "tests"  # where scripts/test.sh looks for them
_BROWSER_S = 240.0  # of a test: its waits have no limit of their own
_QUIET = ("background-networking", "component-update", "sync")
_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    *(f"--disable-{q}" for q in _QUIET),
]


def _find_browser() -> str | None:
    for name in (os.environ.get("TRUNK_CHROMIUM"), "chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name) if name else None
        if (
            path
            and not subprocess.run([path, "--version"], capture_output=True, check=False).returncode
        ):
            return path
    return None


@pytest.fixture(scope="session")
def chromium() -> Iterator[tuple[Any, Any]]:
    """Yield a headless Chromium, started once, and the event loop in which it is asked; none is running."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = _find_browser()
    if path is None:
        pytest.skip("Chromium: scripts/browser.sh installs it, or says why not")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=_ARGUMENTS)
        loop = asyncio.get_running_loop()
        asyncio._set_running_loop(None)
        yield started, loop
        asyncio._set_running_loop(loop)
        started.close()


@pytest.fixture(scope="module")
def browser(chromium: tuple[Any, Any]) -> Iterator[Any]:
    """Yield a headless Chromium; tests that need one carry the mark of this name.

    Playwright's loop waits in a greenlet: it is the running one only in modules with a browser, so that
    others can run their own.
    """
    started, loop = chromium
    asyncio._set_running_loop(loop)
    yield started
    asyncio._set_running_loop(None)


@pytest.fixture
def new_page(browser: Any) -> Iterator[Callable[..., Any]]:
    """Yield a function that opens an empty page, with options of a context; nothing may go wrong in it."""
    contexts: list[Any] = []
    complaints: list[str] = []

    def new(**options: Any) -> Any:
        context = browser.new_context(**options)
        contexts.append(context)
        context.set_default_timeout(0)  # pytest has one
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("dialog", lambda dialog: (complaints.append("dialog"), dialog.dismiss()))
        return page

    yield new
    for context in contexts:
        context.close()
    assert complaints == []


@pytest.fixture
def trunk(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs the command in this process: exit code, stdout, stderr."""
    from trunk_experiments.cli import main

    # What it changes in its process, and this one goes on.
    for name in ("MPLBACKEND", "MATPLOTLIBRC", "SOURCE_DATE_EPOCH"):
        monkeypatch.setenv(name, os.environ.get(name, ""))
    monkeypatch.delenv("SOURCE_DATE_EPOCH")  # NumPy's f2py takes an empty one for a date
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["trunk", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return run


def _count_of_commits() -> str:
    """Return 0 for sources without their history."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-list", "--count", "HEAD"]
    with suppress(OSError):
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout or "0"
    return "0"


os.environ.setdefault("TRUNK_EPOCH", _count_of_commits().strip())  # workers have the same
USES = pytest.StashKey[dict[tuple[str, int], list[str]]]()  # (test, N): the names of its cases


def turn(cases: Iterable[str], test: str, n: int, epoch: int) -> set[str]:
    """Return the share of some cases of a test that runs in an epoch: each case once in ``n`` of them.

    Cases are shuffled by a hash of their names, so that no share has all cases of one parameter.
    """
    shuffled = sorted(cases, key=lambda case: crc32(case.encode()))
    return set(shuffled[(epoch + crc32(test.encode())) % n :: n])


def pytest_report_header() -> str:
    return (
        f"TRUNK_EPOCH={os.environ['TRUNK_EPOCH']}: whose turn it is of the tests that run in part"
    )


@pytest.hookimpl(tryfirst=True)  # before those that -m does not choose are left out
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark as long those cases of ``one_in(N)`` and ``virtual`` whose turn it is not.

    Raises UsageError for a test of the graph where scripts/test.sh does not look for any.
    """
    _required()
    uses: dict[tuple[str, int], list[pytest.Item]] = {}
    files: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("graph") and not item.path.is_relative_to(_GRAPH_TESTS):
            raise pytest.UsageError(
                f"{item.nodeid}: what starts the graph is tested in {_GRAPH_TESTS}"
            )
        if item.get_closest_marker("browser") and not item.get_closest_marker("graph"):
            item.add_marker(pytest.mark.timeout(_BROWSER_S))
        if mark := item.get_closest_marker("one_in"):
            test = item.nodeid.partition("[")[0]
            uses.setdefault((test, mark.args[0]), []).append(item)
        if item.get_closest_marker("virtual"):
            files.setdefault(item.nodeid.partition("::")[0], []).append(item)
    if not config.pluginmanager.hasplugin("tests.graph.virtual"):
        uses |= {(file, len(cases)): cases for file, cases in files.items()}
    for (test, n), cases in uses.items():
        names = [case.nodeid for case in cases]
        in_turn = turn(names, test, n, int(os.environ["TRUNK_EPOCH"]))
        for case in cases:
            if case.nodeid not in in_turn:
                case.add_marker(pytest.mark.long)
    config.stash[USES] = {use: [case.nodeid for case in cases] for use, cases in uses.items()}


# The names that TRUNK_REQUIRE may hold, and how reasons to skip tell of such a tool.
_TOOLS = {
    "browser": r"Chromium|playwright",
    "c": r"apt-get install (gcc|g\+\+)|^gcc:",
    "node": r"Node\.js|nodejs",
}


def missing(reason: str) -> str:
    """Return which of the tools that have to be here is missing where a test is skipped for a reason."""
    return next((tool for tool in _required() if re.search(_TOOLS[tool], reason)), "")


def _required() -> list[str]:
    """Return the names in TRUNK_REQUIRE. Raises UsageError for unknown ones."""
    names = [name.strip() for name in os.environ.get("TRUNK_REQUIRE", "").split(",")]
    if unknown := set(names) - {*_TOOLS, ""}:
        raise pytest.UsageError(
            f"TRUNK_REQUIRE: {', '.join(unknown)}: allowed are {', '.join(_TOOLS)}"
        )
    return [name for name in names if name]


_BEGAN = pytest.StashKey[float]()
_costs: dict[str, tuple[float, float]] = {}


def _work_s() -> float:
    """Return how long the processor has worked for this process and its children that have ended."""
    return sum(os.times()[:4])


def _held_up_s() -> float:
    """Return for how long somebody has waited for a processor, a disk or memory, as Linux tells.

    A container's share may be less than the machine: it has a pressure of its own.
    """
    files = [*Path("/proc/pressure").glob("*"), *Path("/sys/fs/cgroup").glob("*.pressure")]
    with suppress(OSError):  # it is switched off
        if totals := re.findall(r"some .*total=(\d+)", "".join(file.read_text() for file in files)):
            return sum(map(int, totals)) / 1e6
    return monotonic()  # all the time, for all we know


@pytest.hookimpl(wrapper=True)
def pytest_timeout_set_timer(item: pytest.Item, settings: Any) -> Generator[None, Any, Any]:
    """Let time in which somebody is held up count for a third at least: the limit is for what hangs.

    So it holds for every wait, whatever a test waits for and however. pytest-timeout ends and reports.
    """
    done = yield
    give_up = signal.getsignal(signal.SIGALRM)
    if not callable(give_up):  # another method than a signal was asked for
        return done
    step_s = settings.timeout / 60
    left_s, held_up_s = settings.timeout, _held_up_s()

    def look(number: int, frame: FrameType | None) -> None:
        __tracebackhide__ = True
        nonlocal left_s, held_up_s
        before_s, held_up_s = held_up_s, _held_up_s()
        left_s -= max(step_s - (held_up_s - before_s), step_s / 3)
        if left_s <= 0.0:
            signal.setitimer(signal.ITIMER_REAL, 0.0)  # once: it takes time to report
            give_up(number, frame)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, step_s, step_s)
    return done


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[_BEGAN] = _work_s()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    report = yield
    if isinstance(report.longrepr, tuple):  # it was skipped
        reason = report.longrepr[2].removeprefix("Skipped: ")
        if tool := missing(reason):
            report.outcome, report.longrepr = "failed", f"TRUNK_REQUIRE has {tool}: {reason}"
    report.work_s = _work_s() - item.stash[_BEGAN]  # xdist hands on what can be JSON
    return report


def pytest_runtest_logreport(report: Any) -> None:
    wall_s, _ = _costs.get(report.nodeid, (0.0, 0.0))
    _costs[report.nodeid] = wall_s + report.duration, report.work_s


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Note what each test cost: the processor's seconds, its processes' too, those of time, its name."""
    if (file := os.environ.get("TRUNK_DURATIONS")) and not hasattr(session.config, "workerinput"):
        with Path(file).open("a", encoding="utf-8") as stream:
            stream.writelines(
                f"{work:.3f}\t{wall:.3f}\t{n}\n" for n, (wall, work) in _costs.items()
            )


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Note each reason for which tests were skipped, with their number."""
    reasons = Counter(
        report.longrepr[2].removeprefix("Skipped: ").partition("\n")[0]
        for report in terminalreporter.stats.get("skipped", [])
    )
    if file := os.environ.get("TRUNK_SKIPPED"):
        with Path(file).open("a", encoding="utf-8") as stream:
            stream.writelines(f"{count} {reason}\n" for reason, count in reasons.items())
