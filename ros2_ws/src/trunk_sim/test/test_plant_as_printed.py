"""The misprinted equations: how they differ from the derived ones, and that they stay fenced in."""

from math import inf

import numpy as np
import pytest

from trunk_core.mechanics import Body
from trunk_core.parameters.declarations import build
from trunk_sim.config import TrunkSimulator
from trunk_sim.plant import PlantState, advance
from trunk_sim.plants.trunk import as_printed, energy, passive


def states(count):
    for row in np.random.default_rng(5).uniform(-3.0, 3.0, (count, 4)).tolist():
        yield PlantState(*row)


def test_they_solve_the_printed_matrices():
    big, m, ell, g = 2.0, 0.5, 1.0, 9.81
    for state in states(200):
        x, th, xd, thd = state
        a = m * ell * (np.cos(th) - np.cos(x) * np.sin(th))
        mass = np.array([[a, m * ell**2], [(big + m) * (1 + np.cos(x) ** 2), a]])
        v = np.array(
            [
                [m * ell * np.sin(x) * np.sin(th) * xd, 0.0],
                [
                    -(big + m) * np.sin(x) * np.cos(x) * xd,
                    -m * ell * (np.sin(th) + np.cos(th)) * np.cos(x) * thd,
                ],
            ]
        )
        gravity = np.array([m * g * ell * np.sin(th), -(big + m) * g * np.cos(x)])
        u = np.array([-3.0, -7.0])
        expected = np.linalg.solve(mass, v @ [xd, thd] - gravity - u)
        assert as_printed(state, 7.0, 3.0, Body()) == pytest.approx(expected, rel=1e-9)


def test_at_rest_only_the_sign_of_gravity_differs():
    for x, theta, *_ in states(200):
        still = PlantState(x, theta, 0.0, 0.0)
        up = Body(gravity=-9.81)
        expected = passive(still, 1.0, 2.0, up)
        assert as_printed(still, 1.0, 2.0, Body()) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_upright_trunk_needs_no_controller():
    # A pendulum that gravity pulls up swings about the upright; the true one falls.
    p = Body(hip_mass=1e6)
    state, largest = PlantState(np.pi / 2, 0.3, 0.0, 0.0), 0.0
    for _ in range(3000):
        state = advance(state, 0.0, 0.0, 0.001, 1, p, as_printed)
        largest = max(largest, abs(state.theta))
    assert largest < 0.31


def test_energy_is_not_conserved():
    state = PlantState(0.0, 0.5, 1.0, 0.0)
    up = Body(gravity=-9.81)  # whatever gravity's sign
    drift = {}
    for name, p, equations in (("derived", up, passive), ("printed", Body(), as_printed)):
        now = state
        for _ in range(2000):
            now = advance(now, 0.0, 0.0, 0.001, 1, p, equations)
        drift[name] = abs(energy(now, up) - energy(state, up))
    assert drift["derived"] < 1e-8
    assert drift["printed"] > 0.1


def test_a_limit_of_the_torque_is_offered():
    config = build(TrunkSimulator, {"plant.equations": "as_printed", "max_effort": inf})
    assert config.accelerations is as_printed
