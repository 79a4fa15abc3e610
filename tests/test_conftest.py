"""The limit of time of all tests, on a busy machine too; whose turn it is of the tests that run in part."""

import signal
from collections.abc import Iterator
from itertools import chain, count, takewhile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

LIMIT_S = 600.0


@pytest.fixture
def conftest(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Yield the root's conftest.py; afterwards the limit of this test counts as before."""
    handler, timer = signal.getsignal(signal.SIGALRM), signal.getitimer(signal.ITIMER_REAL)
    yield request.config.pluginmanager.get_plugin(str(Path(__file__).parents[1] / "conftest.py"))
    signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, *timer)


@pytest.mark.parametrize(
    ("held_up", "given_up_after_s"), [(0.0, 600.0), (0.5, 1200.0), (1.0, 1800.0), (8.0, 1800.0)]
)
def test_time_in_which_somebody_is_held_up_counts_less(
    conftest: Any, monkeypatch: pytest.MonkeyPatch, held_up: float, given_up_after_s: float
) -> None:
    """``held_up``: processes that wait for a processor at a time."""
    step_s = LIMIT_S / 60
    told_s = count(1000.0, held_up * step_s)
    monkeypatch.setattr(conftest, "_held_up_s", lambda: next(told_s))
    ended: list[int] = []
    signal.signal(signal.SIGALRM, lambda number, frame: ended.append(number))
    begun = conftest.pytest_timeout_set_timer(None, SimpleNamespace(timeout=LIMIT_S))
    next(begun)  # the plugin has set its handler
    next(begun, None)
    look = signal.getsignal(signal.SIGALRM)
    assert callable(look)
    looks = sum(1 for _ in takewhile(lambda _: look(signal.SIGALRM, None) or not ended, count()))
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0), "the report is not interrupted"
    assert looks * step_s == pytest.approx(given_up_after_s, abs=step_s + 1.0)


def test_where_linux_tells_nothing_load_is_taken_for_granted(
    conftest: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: iter(()))
    monkeypatch.setattr(conftest, "monotonic", lambda: 7.0)
    assert conftest._held_up_s() == 7.0


@pytest.mark.parametrize(
    ("required", "reason", "tool"),
    [
        ("", "Chromium: scripts/browser.sh installs it, or says why not", ""),
        ("c,browser", "Chromium: scripts/browser.sh installs it, or says why not", "browser"),
        ("browser", "could not import 'playwright.sync_api'", "browser"),
        ("c", "no C++ compiler: apt-get install g++", "c"),
        ("c", "gcc: for the same bits in C", "c"),
        ("c", "needs gcc on an x86-64 with FMA", ""),  # no tool would help
        ("node", "Node.js: for the same bits in JavaScript", "node"),
        ("browser,c", "Node.js: for the same bits in JavaScript", ""),
    ],
)
def test_who_skips_for_want_of_a_required_tool_fails(
    conftest: Any, monkeypatch: pytest.MonkeyPatch, required: str, reason: str, tool: str
) -> None:
    monkeypatch.setenv("TRUNK_REQUIRE", required)
    assert conftest.missing(reason) == tool
    item = SimpleNamespace(stash={conftest._BEGAN: 0.0})
    report = SimpleNamespace(outcome="skipped", longrepr=("file", 1, f"Skipped: {reason}"))
    made = conftest.pytest_runtest_makereport(item)
    next(made)
    with pytest.raises(StopIteration):
        made.send(report)
    assert report.outcome == ("failed" if tool else "skipped")
    assert not tool or report.longrepr == f"TRUNK_REQUIRE has {tool}: {reason}"


def test_each_case_has_its_turn_once_in_n_epochs(
    conftest: Any, pytestconfig: pytest.Config
) -> None:
    for (test, n), cases in pytestconfig.stash[conftest.USES].items():
        shares = [conftest.turn(cases, test, n, epoch) for epoch in range(1500, 1500 + n)]
        assert sorted(chain.from_iterable(shares)) == sorted(cases), test
        assert {len(share) for share in shares} <= {len(cases) // n, -(-len(cases) // n)}, test
