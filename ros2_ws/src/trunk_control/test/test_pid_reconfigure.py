"""Bumpless retuning: new gains do not move the command."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.pid_family import Gains, PidState, rescaled

gains = st.builds(Gains, p=st.floats(0.0, 1e6), i=st.floats(1e-6, 1e6), d=st.floats(0.0, 1e6))
number = st.floats(-100.0, 100.0)
states = st.builds(
    PidState,
    integral=number,
    error=number,
    measurement=number,
    derivative=number,
    effort=number,
    started=st.just(True),
)


def parts(state: PidState, g: Gains) -> list[float]:
    return [g.p * state.error, g.i * state.integral, g.d * state.derivative]


@given(states, gains, gains)
def test_command_is_continuous(state, old, new):
    after = rescaled(state, old, new)
    assert after._replace(integral=state.integral) == state
    scale = sum(map(abs, parts(state, old) + parts(after, new)))
    assert sum(parts(after, new)) == pytest.approx(
        sum(parts(state, old)), abs=1e-12 * scale + 1e-12
    )


def test_hand_calculation():
    state = PidState(integral=0.5, error=1.0, derivative=-2.0, started=True)
    after = rescaled(state, Gains(2.0, 4.0, 0.5), Gains(1.0, 8.0, 1.0))
    assert after.integral == (3.0 - 1.0 + 2.0) / 8.0


@pytest.mark.parametrize(
    ("state", "old", "new"),
    [
        (PidState(integral=0.5), Gains(1.0, 1.0, 0.0), Gains(2.0, 2.0, 0.0)),
        (PidState(0.5, 1.0, started=True), Gains(1.0, 1.0, 0.0), Gains(2.0, 0.0, 0.0)),
        (PidState(0.1, 0.3, started=True), Gains(0.7, 0.3, 0.0), Gains(0.7, 0.3, 0.0)),
    ],
    ids=["not-started", "no-integral-gain", "same-gains"],
)
def test_nothing_to_rescale(state, old, new):
    assert rescaled(state, old, new) == state
