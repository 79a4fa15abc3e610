"""Runge-Kutta: its order, where it is exact, what it conserves."""

from __future__ import annotations

from itertools import pairwise
from math import log2, pi

import pytest

from trunk_msgs_util.mechanics import Body
from trunk_sim.integrator import advance, rk4_step
from trunk_sim.plant import PlantState, energy

PLANT = Body()
START = PlantState(0.0, pi / 6.0, 1.0, 0.0)


def run(steps: int, duration: float, p: Body = PLANT) -> PlantState:
    return advance(START, 0.5, 1.5, duration, steps, p)


@pytest.mark.parametrize("prescribed", [False, True], ids=["passive", "prescribed"])
def test_global_error_has_order_four(prescribed):
    p = PLANT._replace(prescribed=prescribed)
    exact = run(20_000, 1.0, p)
    errors = [
        max(abs(a - b) for a, b in zip(run(steps, 1.0, p), exact, strict=True))
        for steps in (50, 100, 200, 400)
    ]
    orders = [log2(a / b) for a, b in pairwise(errors)]
    assert orders == pytest.approx([4.0] * 3, abs=0.15)


def test_constant_acceleration_is_integrated_exactly():
    # No gravity, a straight path, a given hip: theta'' = torque / (m l^2), a quadratic in t.
    p = Body(gravity=0.0, amplitude=0.0, prescribed=True)
    state = rk4_step(PlantState(0.25, 0.5, 1.5, -2.0), 0.0, 3.0, 0.5, p)
    assert state == pytest.approx((1.0, 0.5 - 1.0 + 0.5 * 6.0 * 0.25, 1.5, 1.0), rel=1e-15)


def test_free_plant_keeps_its_energy():
    initial = energy(START, PLANT)
    state, drift = START, 0.0
    for _ in range(10_000):
        state = rk4_step(state, 0.0, 0.0, 1e-3, PLANT)
        drift = max(drift, abs(energy(state, PLANT) - initial))
    assert state.theta != pytest.approx(START.theta, abs=0.1)  # it did move
    assert drift <= 1e-8


def test_held_torque_does_its_work():
    # A torque is conservative while it is held: E - torque * theta stays.
    torque, force = 2.0, -1.5
    state = START
    for _ in range(1000):
        state = rk4_step(state, force, torque, 1e-3, PLANT)
    work = torque * (state.theta - START.theta) + force * (state.x - START.x)
    assert energy(state, PLANT) - energy(START, PLANT) == pytest.approx(work, abs=1e-8)


def test_prescribed_hip_keeps_its_speed():
    p = PLANT._replace(prescribed=True)
    state = START
    for _ in range(2000):
        state = rk4_step(state, 50.0, 3.0, 1e-3, p)
    assert state.x_dot == START.x_dot
    assert state.x == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("substeps", [1, 3, 10])
def test_substeps_are_equal_steps(substeps):
    state = START
    for _ in range(substeps):
        state = rk4_step(state, 0.5, 1.5, 0.005 / substeps, PLANT)
    assert advance(START, 0.5, 1.5, 0.005, substeps, PLANT) == state
