"""Which states are answered with an update: those nearest to the due instants, whatever the clocks do."""

from functools import partial

import numpy as np
import pytest

from trunk_control.controller import Controller, settings_of
from trunk_control.decide import Reading, decide, states_per_update
from trunk_control.law import Hip
from trunk_control.pid import PidConfig
from trunk_core.compiled import compiled, with_arrays

MS, RATE = 1_000_000, 200.0
CONTROLLER = Controller(PidConfig(update_rate=RATE))


UPDATE, TRANSFER = CONTROLLER.law.update, CONTROLLER.law.transfer


def updates(stamps, state, settings, constants, out):
    for k in range(len(stamps)):
        reading = Reading(int(stamps[k]), 0.1, 0.0, Hip(0.0, 0.0), 0.0, False, 0.0)
        state, answer = decide(state, reading, settings, constants, UPDATE, TRANSFER)
        out[k] = answer.updated
    return state


@pytest.fixture(scope="module")
def updated():
    """Return the indices of the states that are updates, and compare CPython's with compiled code's."""
    constants = tuple(map(with_arrays, CONTROLLER.constants))
    fast = compiled(updates)

    def indices(stamps, rate=RATE, first=20_000):
        settings = with_arrays(settings_of(PidConfig(update_rate=rate)))
        arguments = CONTROLLER.state, settings, constants
        stamps = np.asarray(stamps, dtype=np.int64)
        out, expected = np.zeros(len(stamps), dtype=bool), np.zeros(len(stamps[:first]), dtype=bool)
        fast(stamps, *arguments, out)
        updates(stamps[:first], *arguments, expected)
        assert (out[:first] == expected).all()
        return np.flatnonzero(out)

    return indices


def stamps(rate, seconds, jitter_ns=0, ppm=0.0):
    """Return a robot's stamps, its clock fast by so many ppm, each stamp off by up to ``jitter_ns``."""
    count = int(seconds * rate)
    regular = np.arange(count) * (1e9 / rate * (1.0 - 1e-6 * ppm))
    return np.rint(regular + np.random.default_rng(7).uniform(-jitter_ns, jitter_ns, count))


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("robot", "every"),
    [
        (partial(stamps, 200.0, 60.0, 50_000), 1),
        (partial(stamps, 200.0, 60.0, 800_000), 1),
        (partial(stamps, 200.0, 600.0, 0, 100.0), 1),
        (partial(stamps, 200.0, 600.0, 0, -100.0), 1),
        (partial(stamps, 200.0, 600.0, 50_000, 100.0), 1),
        (partial(stamps, 200.0, 600.0, 50_000, -100.0), 1),
        (partial(stamps, 201.5, 60.0), 1),
        (partial(stamps, 1000.0, 60.0, 50_000, 50.0), 5),
        (partial(stamps, 600.0, 60.0, 50_000), 3),
        (lambda: 1_666_667 * np.arange(2 * 3600 * 600), 3),
        (lambda: 1_666_666 * np.arange(2 * 3600 * 600), 3),
    ],
    ids=["jitter", "large jitter", "100 ppm fast", "100 ppm slow", "fast, jitter", "slow, jitter",
         "0.75 % fast", "1 kHz, jitter", "600 Hz, jitter", "600 Hz", "600 Hz, fast"],
)  # fmt: skip
def test_no_state_is_skipped_and_none_doubled(updated, robot, every):
    at = updated(robot())
    assert (np.diff(at) == every).all()
    assert len(at) == -(-len(robot()) // every)


@pytest.mark.parametrize("rate", [205.0, 210.0, 300.0, 333.0, 555.5, 937.0, 4321.0])
@pytest.mark.parametrize("jitter_ns", [0, 20_000])
def test_where_no_ratio_is_whole_the_rate_is_kept(updated, rate, jitter_ns):
    times = stamps(rate, 100.0, jitter_ns)
    at = updated(times)
    # With jitter some single step may look as if the ratio were whole.
    assert len(at) == pytest.approx(100.0 * RATE, abs=1 if jitter_ns == 0 else 40)
    if jitter_ns == 0:  # each is the nearest to its due instant
        assert np.abs(times[at] - 5 * MS * np.arange(len(at))).max() <= 0.5e9 / rate + 1


@pytest.mark.parametrize("rate", [150.0, 120.0, 199.0, 50.0, 134.0])
def test_states_that_come_more_slowly_are_all_answered(updated, rate):
    times = stamps(rate, 20.0, 20_000)
    assert len(updated(times)) == len(times)


def test_after_a_gap_there_is_no_burst(updated):
    times = [*range(0, 100 * MS, MS), *range(247 * MS, 400 * MS, MS)]
    at = updated(times)
    assert at[20] == 100  # the first state after the gap, overdue
    assert (np.diff(at) == 5).all()


def test_lost_states_do_not_shift_the_due_instants(updated):
    kept = np.random.default_rng(3).random(60_000) > 0.3
    kept[:7] = True
    times = MS * np.flatnonzero(kept)
    at = updated(times)
    assert len(at) / 60_000 == pytest.approx(0.2, rel=0.02)


def test_a_repeated_state_is_answered_once(updated):
    assert (updated(np.repeat(5 * MS * np.arange(100), 3)) % 3 == 0).all()


def test_every_multiple_is_exact(updated):
    for every in (1, 2, 3, 7, 49, 50, 51, 100, 1000):
        step = 5 * MS // every
        at = updated(np.arange(20 * every + 1) * step)
        assert states_per_update(step, 5 * MS) == every
        assert (np.diff(at) == every).all()


def test_between_two_states_the_earlier_is_answered():
    assert states_per_update(2, 201) == 100
    assert states_per_update(2, 199) == 99
