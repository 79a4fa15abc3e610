"""The cart-pole against the trunk, the book, its own energy and MuJoCo."""

from dataclasses import replace
from math import pi
from random import Random

import numpy as np
import pytest

from trunk_core.mechanics import Body
from trunk_sim.api import PlantState
from trunk_sim.plant import advance
from trunk_sim.plants.cart_pole import (
    PLANT,
    CartPole,
    CartPoleConfig,
    accelerations,
    energy,
)
from trunk_sim.plants.trunk import passive

USUAL = CartPoleConfig().constants
HEAVY = CartPole(cart_mass=0.7, mass=1.9, length=1.3, gravity=3.7, friction=0.4)


def test_mirrored_it_is_the_trunk_on_level_ground():
    draw = Random(1).uniform
    for _ in range(3000):
        c = CartPole(draw(0.1, 5.0), draw(0.1, 5.0), draw(0.1, 2.0), draw(0.0, 20.0), 0.0)
        x, theta, x_dot, theta_dot = (draw(-10.0, 10.0) for _ in range(4))
        force, torque = draw(-50.0, 50.0), draw(-50.0, 50.0)
        body = Body(c.cart_mass, c.mass, c.length, c.gravity, amplitude=0.0)
        mirrored = PlantState(x, -theta, x_dot, -theta_dot)  # the trunk leans forwards
        x_ddot, theta_ddot = passive(mirrored, force, -torque, body)
        given = accelerations(PlantState(x, theta, x_dot, theta_dot), force, torque, c)
        scale = max(abs(x_ddot), abs(theta_ddot))
        assert given == pytest.approx((x_ddot, -theta_ddot), rel=0.0, abs=1e-12 * scale)


def slopes(c: CartPole, step: float = 1e-5) -> np.ndarray:
    """Return the slopes of both accelerations at rest over x, theta, x', theta', F and tau [2, 6]."""
    columns = []
    for place in range(6):
        ends = []
        for shift in (step, -step):
            numbers = [0.0] * 6
            numbers[place] = shift
            ends.append(accelerations(PlantState(*numbers[:4]), *numbers[4:], c))
        columns.append((np.array(ends[0]) - ends[1]) / (2.0 * step))
    return np.array(columns).T


@pytest.mark.parametrize("c", [USUAL, HEAVY], ids=["usual", "heavy"])
def test_its_slopes_at_rest_are_those_of_the_book(c):
    """Astrom and Murray, *Feedback Systems*, balance systems, with J = 0, gamma = 0 and friction c."""
    m_total, ml = c.cart_mass + c.mass, c.mass * c.length
    j_total = c.mass * c.length * c.length
    mu = m_total * j_total - ml * ml
    book = [
        [0.0, ml * ml * c.gravity / mu, -c.friction * j_total / mu, 0.0, j_total / mu],
        [0.0, m_total * ml * c.gravity / mu, -c.friction * ml / mu, 0.0, ml / mu],
    ]
    assert slopes(c)[:, :5] == pytest.approx(np.array(book), rel=1e-6, abs=1e-9)


def test_its_usual_numbers():
    """Written out for the defaults: poles at 0, 0 and +-4.5388 1/s."""
    a = slopes(USUAL)
    assert a[:, 1] == pytest.approx([0.4905, 20.601], rel=1e-6)
    assert a[:, 4] == pytest.approx([0.5, 1.0], rel=1e-6)
    assert a[1, 1] ** 0.5 == pytest.approx(4.5388, abs=5e-5)


@pytest.mark.parametrize(
    "state",
    [PLANT.start, PlantState(0.3, 2.0, -1.0, 3.0), PlantState(0.0, -0.1, 2.0, -4.0)],
    ids=["start", "falling", "thrown"],
)
def test_free_it_keeps_its_energy(state):
    begun = energy(state, USUAL)
    for _ in range(20):
        state = advance(state, 0.0, 0.0, 0.1, 100, USUAL, accelerations)
        assert abs(energy(state, USUAL) - begun) <= 1e-8


def test_friction_takes_energy_at_the_rate_of_its_power():
    c, h = HEAVY, 1e-4
    state = PlantState(0.0, 0.4, 1.5, -2.0)
    after = advance(state, 0.0, 0.0, h, 1, c, accelerations)
    lost = (energy(after, c) - energy(state, c)) / h
    mean = 0.5 * (state.x_dot + after.x_dot)
    assert lost == pytest.approx(-c.friction * mean * mean, rel=1e-4)


def test_its_bounds_keep_it_from_dividing_by_zero():
    smallest = replace(CartPoleConfig(), cart_mass=1e-6, mass=1e-6, length=1e-6)
    result = accelerations(PlantState(0.0, pi, 0.0, 0.0), 1.0, 1.0, smallest.constants)
    assert np.all(np.isfinite(result))


MJCF = """
<mujoco>
  <option timestep="0.001" gravity="0 0 -{c.gravity}" integrator="RK4">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
    <body>
      <joint name="cart" type="slide" axis="1 0 0" damping="{c.friction}"/>
      <inertial pos="0 0 0" mass="{c.cart_mass}" diaginertia="1e-11 1e-11 1e-11"/>
      <body>
        <joint name="pole" type="hinge" axis="0 -1 0"/>
        <inertial pos="0 0 {c.length}" mass="{c.mass}" diaginertia="1e-11 1e-11 1e-11"/>
      </body>
    </body>
  </worldbody>
  <actuator> <motor joint="cart"/> <motor joint="pole"/> </actuator>
</mujoco>
"""


@pytest.mark.parametrize("c", [USUAL, HEAVY], ids=["usual", "heavy"])
@pytest.mark.parametrize("forces", [(0.0, 0.0), (3.0, 0.0), (-2.0, 0.05)])
def test_mujoco_moves_it_alike(c, forces):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo: scripts/bench_libraries.sh")
    model = mujoco.MjModel.from_xml_string(MJCF.format(c=c))
    data = mujoco.MjData(model)
    state = PlantState(0.2, 0.3, -0.5, 0.4)
    data.qpos[:], data.qvel[:], data.ctrl[:] = state[:2], state[2:], forces
    for _ in range(1000):
        mujoco.mj_step(model, data)
    ours = advance(state, *forces, 1.0, 1000, c, accelerations)
    assert data.qpos == pytest.approx(ours[:2], rel=0.0, abs=1e-6)
