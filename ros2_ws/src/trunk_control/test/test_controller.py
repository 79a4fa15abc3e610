"""Controllers driven by stamps: due instants, time steps, reset, retuning."""

from dataclasses import replace
from math import nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_control.controller import Controller
from trunk_control.fuzzy_pid import FuzzyPidConfig, fuzzy_pid_update
from trunk_control.fuzzy_torque import FuzzyConfig
from trunk_control.law import Sample
from trunk_control.lqr import LqrConfig
from trunk_control.pid import PidConfig, pid_update
from trunk_control.pid_family import PidState
from trunk_control.state_feedback import StateFeedbackConfig
from trunk_core.units import period_ns

MS = 1_000_000
FREE = {"u_clamp_max": 1e9, "u_clamp_min": -1e9, "antiwindup_strategy": "none"}
every = pytest.mark.parametrize(
    ("make", "config"),
    [
        (Controller, PidConfig(**FREE)),
        (Controller, FuzzyPidConfig(**FREE)),
        (Controller, LqrConfig(**FREE)),
        (Controller, ComputedTorqueConfig(**FREE)),
        (Controller, StateFeedbackConfig(**FREE)),
        (Controller, FuzzyConfig(**FREE)),
        (Controller, FuzzyConfig(form="pi", **FREE)),
    ],
    ids=["pid", "fuzzy_pid", "lqr", "computed_torque", "state_feedback", "fuzzy", "fuzzy_pi"],
)


@every
@pytest.mark.parametrize(
    ("plant_rate", "rate", "divisor"),
    [
        (1000.0, 1000.0, 1),
        (1000.0, 200.0, 5),
        (700.0, 100.0, 7),  # 7 * 1428571 ns is just under 10 ms
        (700.0, 350.0, 2),  # 2 * 1428571 ns is just under 2857143 ns
        (60.0, 20.0, 3),  # 3 * 16666667 ns is just over 50 ms
        (60.0, 30.0, 2),
        (144.0, 72.0, 2),
        (999.0, 333.0, 3),
        (3000.0, 3.0, 1000),
        (1e6, 1e6 / 3.0, 3),
    ],
    ids=lambda value: f"{value:g}" if isinstance(value, (int, float)) else None,
)
def test_updates_are_due_at_every_nth_state(make, config, plant_rate, rate, divisor):
    controller = make(replace(config, update_rate=rate))
    period = period_ns(plant_rate)
    for k in range(20 * divisor):
        answer = controller.update(k * period, 0.1, 0.0)
        assert answer.updated == (k % divisor == 0), k


@every
def test_command_is_held_between_due_instants(make, config):
    controller = make(replace(config, update_rate=100.0))
    due = controller.update(0, 0.3, 0.5)
    assert (due.active, due.updated, due.held) == (True, True, False)
    state = controller.memory
    for k in range(1, 10):
        held = controller.update(k * MS, 0.3 + k, -k)
        assert (held.effort, held.updated, held.terms) == (
            due.effort,
            False,
            controller.law.no_terms,
        )
        assert (held.active, held.held) == (True, False)
        assert controller.memory == state
    assert controller.update(10 * MS, 0.4, 0.1).updated


def test_dt_is_taken_from_the_stamps():
    config = PidConfig(**FREE, derivative_mode="error", update_rate=200.0)
    controller, expected = Controller(config), PidState()
    stamps = [0, 5, 13, 20, 45]
    for i, stamp in enumerate(stamps):
        dt = (stamp - stamps[i - 1]) * MS / 1e9 if i else 0.005  # at first the period
        angle = 0.1 * (i + 1) ** 2
        expected, terms = pid_update(expected, 0.0, angle, 0.0, dt, config.gains, config.limits)
        assert controller.update(stamp * MS, angle, 0.0).terms == terms


def test_fuzzy_controller_runs_its_law():
    config = FuzzyPidConfig(**FREE)
    controller, expected = Controller(config), PidState()
    for k in range(5):
        sample = Sample(0.0, 0.1 * k, -0.5 * k, 0.005)
        expected, terms = fuzzy_pid_update(expected, sample, config.constants, config.limits)
        assert controller.update(k * 5 * MS, *sample[1:3]).terms == terms


def test_a_reference_by_topic_keeps_the_sign_of_zero():
    controller = Controller(PidConfig(reference_profile="topic"))
    assert str(controller.update(0, 0.1, 0.0, -0.0).reference) == "-0.0"


@every
def test_reference_comes_from_the_profile_or_the_topic(make, config):
    config = replace(
        config, reference_profile="step", reference_value=0.5, reference_step_time=0.01
    )
    controller = make(config)
    given = [controller.update(k * 5 * MS, 0.0, 0.0).reference for k in range(3)]
    assert given == [0.0, 0.0, 0.5]
    # A message counts only while the profile is "topic".
    assert controller.update(15 * MS, 0.2, 0.0, reference=-0.25).reference == 0.5
    controller.reconfigure(replace(config, reference_profile="topic", reference_value=0.125))
    assert controller.update(20 * MS, 0.2, 0.0).reference == 0.125
    answer = controller.update(25 * MS, 0.2, 0.0, reference=-0.25)
    assert (answer.reference, answer.terms.error) == (-0.25, -0.45)
    controller.reconfigure(config)
    assert controller.update(30 * MS, 0.2, 0.0, reference=-0.25).reference == 0.5


@every
def test_a_stamp_that_goes_backwards_resets(make, config):
    used, fresh = make(config), make(config)
    for k in range(10):
        used.update((100 + 5 * k) * MS, 0.3, 1.0)
    again = fresh.update(144 * MS, 0.2, 0.5)
    assert used.update(144 * MS, 0.2, 0.5) == again._replace(restarted=True)
    assert used.memory == fresh.memory


@every
def test_the_same_stamp_twice_is_one_sample(make, config):
    controller = make(config)
    first = controller.update(0, 0.3, 1.0)
    second = controller.update(0, 9.0, 9.0)
    assert (second.effort, second.updated) == (first.effort, False)


@every
def test_reset_forgets_everything(make, config):
    used, fresh = make(config), make(config)
    for k in range(10):
        used.update(5 * k * MS, 0.3, 1.0)
    used.reset()
    assert used.update(99 * MS, 0.2, 0.5) == fresh.update(99 * MS, 0.2, 0.5)


@every
@pytest.mark.parametrize("mode", ["error", "measurement", "rate"])
def test_a_non_finite_sample_is_skipped(make, config, mode):
    # All goes on as if that state had never come: dt spans the gap.
    config = replace(config, derivative_mode=mode)
    disturbed, spared = make(config), make(config)
    for k, angle in enumerate((0.1, 0.2)):
        last = spared.update(5 * k * MS, angle, 1.0)
        assert disturbed.update(5 * k * MS, angle, 1.0) == last
    answer = disturbed.update(10 * MS, nan, 1.0)
    assert (answer.effort, answer.updated, answer.held) == (last.effort, False, True)
    assert answer.active
    for k, angle in ((3, 0.4), (4, 0.5)):
        assert disturbed.update(5 * k * MS, angle, 1.0) == spared.update(5 * k * MS, angle, 1.0)


@every
@pytest.mark.parametrize("bad", [(nan, 0.0), (0.1, nan)], ids=["angle", "rate"])
def test_no_command_before_the_first_finite_sample(make, config, bad):
    controller = make(config)
    assert controller.update(0, *bad).effort == 0.0
    assert controller.memory == PidState()


GAIN = st.floats(1e-3, 1e3)


@given(GAIN, GAIN, GAIN, st.floats(-1.0, 1.0), st.floats(-4.0, 4.0))
@settings(max_examples=50)
def test_retuning_a_pid_is_bumpless(p, i, d, angle, rate):
    config = PidConfig(**FREE)
    check_bumpless(Controller(config), replace(config, p=p, i=i, d=d), angle, rate)


@given(GAIN, GAIN, st.floats(-1.0, 1.0), st.floats(-4.0, 4.0), st.sampled_from(["linear", "log"]))
@settings(max_examples=50)
def test_retuning_a_fuzzy_pid_is_bumpless(p_max, d_max, angle, rate, consequents):
    config = FuzzyPidConfig(**FREE)
    new = replace(
        config,
        p_min=0.5 * p_max,
        p_max=p_max,
        d_min=0.5 * d_max,
        d_max=d_max,
        alpha_centers=(1.0, 2.0, 3.0, 7.0),
        consequents=consequents,
    )
    check_bumpless(Controller(config), new, angle, rate)


def check_bumpless(controller, new, angle, rate):
    """With the angle and the rate at rest, the next command moves by ki h e alone."""
    for k in range(20):
        before = controller.update(5 * k * MS, angle, rate)
    controller.reconfigure(new)
    after = controller.update(100 * MS, angle, rate)
    terms = after.terms
    increment = terms.ki * 0.005 * terms.error
    scale = abs(terms.p_term) + abs(terms.i_term) + abs(terms.d_term) + abs(before.effort)
    assert after.effort - before.effort == pytest.approx(increment, abs=1e-12 * scale + 1e-12)


@every
def test_retuning_before_the_first_sample(make, config):
    controller = make(config)
    controller.reconfigure(replace(config, reference_value=0.5))
    assert controller.update(0, 0.0, 0.0).reference == 0.5
    assert controller.memory.started
