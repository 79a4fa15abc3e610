"""Measures computed from two streams of timestamps; no process, no timing of this machine."""

from __future__ import annotations

import pytest
from benchmarks import nodes as bench
from benchmarks.harness import BenchError

MS = 1_000_000
EVEN = {k: 5 * k * MS for k in range(101)}  # stamps need not be the instants: 200 Hz


def test_an_even_stream_answered_at_once():
    found = bench.timing(EVEN, {k: t + 200_000 for k, t in EVEN.items()}, 200.0)
    assert found["period, std dev"] == pytest.approx(0.0, abs=1e-6)
    assert found["missed steps"] == found["unanswered"] == 0
    for name in (bench.LATENCY, "latency, 99 %", "latency, 99.9 %"):
        assert found[name] == pytest.approx(200.0)


def test_late_and_missed_steps():
    states = {k: t for k, t in EVEN.items() if k not in (10, 20, 21)}
    states[50] += 2 * MS  # late by less than a period: not missed
    found = bench.timing(states, states, 200.0)
    assert found["missed steps"] == 3
    assert found["period, 99.9 %"] == pytest.approx(9.6e3, rel=0.05)  # of 10 ms, the longest
    assert found["period, std dev"] > 500.0


def test_a_burst_does_not_make_up_for_the_steps_that_it_missed():
    states = {k: max(t, 30 * MS) if 2 < k < 6 else t for k, t in EVEN.items()}
    assert bench.timing(states, states, 200.0)["missed steps"] == 3


def test_latency_is_of_a_state_and_its_own_answer():
    answers = {k: t + (k % 10) * MS for k, t in EVEN.items()}
    del answers[40]
    answers[-1] = 0  # of a state from before
    found = bench.timing(EVEN, answers, 200.0)
    assert found[bench.LATENCY] == pytest.approx(4500.0, abs=510.0)
    assert found["latency, 99.9 %"] == pytest.approx(9000.0)
    assert found["unanswered"] == 1


def test_the_last_states_cannot_have_been_answered():
    answers = {k: t + MS for k, t in EVEN.items() if k < 99}
    assert bench.timing(EVEN, answers, 200.0)["unanswered"] == 0


@pytest.mark.parametrize(
    ("states", "answers", "message"),
    [({1: 1, 2: 2}, {}, "only 2 states"), (EVEN, {-1: 0}, "no state was answered")],
    ids=["too few states", "no answers"],
)
def test_too_few_messages_are_refused(states, answers, message):
    with pytest.raises(BenchError, match=message):
        bench.timing(states, answers, 200.0)
