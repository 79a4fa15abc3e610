"""The comparison itself: rows, agreement first, alternation, missing libraries. No time is asserted."""

from __future__ import annotations

import gc
import sys

import pytest
from benchmarks import core as bench

LIBRARIES = ("fuzzylite", "simple_pid")


@pytest.fixture
def libraries():
    for library in LIBRARIES:
        pytest.importorskip(
            library,
            reason="libraries compared against in benchmarks: scripts/bench_libraries.sh",
        )


@pytest.mark.usefixtures("libraries")
def test_rows():
    fuzzy, pid, fuzzy_pid, large = bench.compare(rounds=1)
    assert (large.goal, large.ratio) == ("", pytest.approx(large.ours / large.theirs))
    assert (fuzzy.goal, pid.goal, fuzzy_pid.goal) == (">= 2000", "<= 2", "")
    assert fuzzy.ratio == pytest.approx(fuzzy.theirs / fuzzy.ours)  # of one round: no median yet
    assert pid.ratio == pytest.approx(pid.ours / pid.theirs)
    assert fuzzy_pid.ratio == pytest.approx(fuzzy_pid.ours / fuzzy_pid.theirs)
    assert fuzzy.met == (fuzzy.ratio >= 2000.0)
    assert pid.met == (pid.ratio <= 2.0)
    assert fuzzy_pid.met is None


@pytest.mark.usefixtures("libraries")
def test_pyfuzzylite_must_agree(monkeypatch):
    true = bench.infer

    def off(error, rate, rules):
        kp, kd, alpha = true(error, rate, rules)
        return kp, kd, alpha + 1e-11

    monkeypatch.setattr(bench, "infer", off)
    with pytest.raises(bench.BenchError, match="pyfuzzylite gives"):
        bench.compare(rounds=1)


@pytest.mark.usefixtures("libraries")
def test_simple_pid_must_agree(monkeypatch):
    monkeypatch.setattr(bench, "_LIMITS", bench._LIMITS._replace(derivative=0, u_max=99.0))
    with pytest.raises(bench.BenchError, match="simple-pid gives"):
        bench.compare(rounds=1)


@pytest.mark.parametrize(
    ("library", "line"),
    [
        (
            "fuzzylite",
            "pyfuzzylite is not installed; install it with: pip install --no-deps -r requirements/fuzzy.txt",
        ),
        (
            "simple_pid",
            "simple-pid is not installed; install it with: pip install -r requirements/dev.txt",
        ),
    ],
)
def test_a_missing_library_gives_one_clear_line(monkeypatch, library, line):
    for name in LIBRARIES:
        monkeypatch.setitem(sys.modules, name, sys)  # installed, whatever it is
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(bench.BenchError) as caught:
        bench.compare()
    assert str(caught.value) == line


def test_contenders_alternate_and_the_order_rotates():
    order: list[str] = []

    def batch(name):
        return lambda: order.append(name) or 10

    times = bench._measure({name: batch(name) for name in "abc"}, rounds=4)
    assert "".join(order) == "abc" + "abc" + "bca" + "cab" + "abc"  # warm-up, then the rounds
    assert {name: len(values) for name, values in times.items()} == {"a": 4, "b": 4, "c": 4}
    assert gc.isenabled()
