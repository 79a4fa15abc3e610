"""Controllers that take over from one another: turns by the states' stamps, no bump in the torque."""

from dataclasses import replace
from itertools import pairwise
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_control.controller import Controller
from trunk_control.decide import active_at, transfer_limits, turn
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.law import Hip, Limits
from trunk_control.lqr import LqrConfig
from trunk_control.pid import PidConfig
from trunk_control.state_feedback import StateFeedbackConfig

MS = 1_000_000
every = pytest.mark.parametrize(
    ("make", "config"),
    [
        (Controller, PidConfig()),
        (Controller, FuzzyPidConfig()),
        (Controller, LqrConfig()),
        (Controller, ComputedTorqueConfig(i=1.0)),
        (Controller, StateFeedbackConfig(x=-4.0, v=-3.0)),
    ],
    ids=["pid", "fuzzy_pid", "lqr", "computed_torque", "state_feedback"],
)
MODES = ["error", "measurement", "rate"]
angles = st.floats(-1.0, 1.0)


def transferring(make, config, position=0.125):
    """Return a controller that saw a state and becomes active before the next."""
    controller = make(config)
    controller.deactivate()
    controller.see(0, position)
    controller.activate()
    return controller


@pytest.mark.slow
@every
@pytest.mark.parametrize("mode", MODES)
@given(position=angles, rate=st.floats(-3.0, 3.0), effort=st.floats(-80.0, 80.0))
def test_the_first_command_is_the_torque_that_acts(make, config, mode, position, rate, effort):
    controller = transferring(make, replace(config, derivative_mode=mode), position - 0.005 * rate)
    answer = controller.update(5 * MS, position, rate, 0.0, Hip(0.3, 1.0), effort)
    assert answer.effort == pytest.approx(effort, abs=1e-9)
    assert answer.terms.i_term != 0.0 or effort == pytest.approx(answer.terms.p_term, abs=1.0)


@every
@pytest.mark.parametrize("mode", MODES)
def test_the_commands_after_it_stay_near(make, config, mode):
    """Without the last state as its past, the derivative of the error would kick here."""
    controller = transferring(make, replace(config, derivative_mode=mode), 0.1)
    commands = [-9.0]
    for k in range(1, 6):
        angle = 0.1 + 0.004 * k  # 0.8 rad/s
        answer = controller.update(5 * k * MS, angle, 0.8, 0.0, Hip(), commands[-1])
        commands.append(answer.effort)
    jumps = [abs(b - a) for a, b in pairwise(commands)]
    assert max(jumps) < 1.0


def test_what_the_integral_cannot_absorb_comes_in_bounded_steps():
    config = PidConfig(i=0.0, d=0.0, handover_step=2.0, reference_profile="topic")
    controller = transferring(Controller, config)
    commands = [20.0]
    for k in range(1, 12):
        commands.append(controller.update(5 * k * MS, 0.0, 0.0, 0.1, effort=20.0).effort)
    # From the acting 20 N m to the law's 60 * 0.1, then unrestricted.
    assert commands == [20.0, 18.0, 16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 6.0, 6.0, 6.0, 6.0]
    assert controller.update(100 * MS, 0.0, 0.0, 1.0, effort=6.0).effort == 60.0


def test_the_command_limits_override_the_transfer():
    config = PidConfig(u_clamp_max=10.0, u_clamp_min=-10.0, reference_profile="topic")
    controller = transferring(Controller, config)
    assert controller.update(5 * MS, 0.0, 0.0, 0.5, effort=90.0).effort == 10.0
    # At the law's limit it has met the law: it may move down freely.
    assert controller.update(10 * MS, 0.0, 0.0, -0.5, effort=10.0).effort == -10.0


@given(
    effort=st.floats(-1e3, 1e3),
    step=st.floats(1e-3, 1e3),
    low=st.floats(-50, 0),
    high=st.floats(0, 50),
)
def test_narrowed_limits_never_exceed_the_laws(effort, step, low, high):
    law = transfer_limits(Limits(u_min=low, u_max=high), effort, step)
    assert low <= law.u_min <= law.u_max <= high
    assert transfer_limits(Limits(), effort, inf) == Limits()


@pytest.mark.parametrize(("seen_ms", "error_rate"), [(2, -10.0), (5, -6.0)])
def test_its_first_step_is_the_time_since_the_state_before(seen_ms, error_rate):
    controller = Controller(PidConfig(derivative_mode="error", update_rate=200.0))
    controller.deactivate()
    controller.see(seen_ms * MS, 0.1)
    controller.activate()
    answer = controller.update(5 * MS, 0.13, 0.0, 0.0)  # at the same stamp: over one period
    assert answer.terms.error_rate == pytest.approx(error_rate)


def test_a_filter_begins_at_rest_and_the_torque_goes_on():
    config = PidConfig(derivative_mode="measurement", derivative_filter_time=0.02)
    controller = transferring(Controller, config, 0.1)
    answer = controller.update(5 * MS, 0.11, 0.0, 0.0, effort=-5.0)
    assert answer.effort == pytest.approx(-5.0)
    assert answer.terms.error_rate == pytest.approx(0.005 / 0.025 * (-0.01 / 0.005))


@every
def test_a_controller_keeps_its_turns(make, config):
    controller = make(replace(config, active_times=(0.01, 0.02)))
    answers = [controller.update(5 * k * MS, 0.1, 0.0, effort=-4.0) for k in range(6)]
    assert [answer.active for answer in answers] == [False, False, True, True, False, False]
    assert [answer.updated for answer in answers] == [False, False, True, True, False, False]
    assert not any(answer.held for answer in answers)
    assert answers[2].effort == pytest.approx(-4.0, abs=1.0)


@every
def test_activation_starts_from_scratch_if_no_state_was_seen(make, config):
    fresh, woken = make(config), make(config)
    woken.deactivate()
    woken.activate()
    for k in range(5):
        arguments = (5 * k * MS, 0.2 - 0.01 * k, -2.0)
        assert woken.update(*arguments, effort=33.0) == fresh.update(*arguments)


def test_activating_an_active_controller_changes_nothing():
    controller = Controller(PidConfig())
    first = controller.update(0, 0.1, 0.0)
    controller.activate()
    state = controller.memory
    assert not controller.state.transfer.pending
    assert state.effort == first.effort


def test_a_reset_ends_the_transfer():
    controller = transferring(Controller, PidConfig(i=0.0, reference_profile="topic"))
    controller.update(5 * MS, 0.0, 0.0, 0.1, effort=20.0)
    controller.reset()
    assert controller.update(10 * MS, 0.0, 0.0, 0.1, effort=20.0).effort == pytest.approx(6.0)


def test_turns():
    times = (0, 40, 70)
    assert [active_at(times, t) for t in (0, 39, 40, 69, 70, 10**12)] == [
        True,
        True,
        False,
        False,
        True,
        True,
    ]
    assert active_at((), 5)
    assert not active_at((10,), 9)
    assert turn(times, -1, 0) == 1
    assert turn(times, 0, 39) == 0
    assert turn(times, 39, 41) == -1
    assert turn(times, 41, 100) == 1
    assert turn((), -1, 0) == 0
    assert turn((10,), 9, 10) == 1
