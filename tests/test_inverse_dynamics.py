"""The controller's inverse dynamics invert the plant's accelerations: two solutions of one Lagrangian."""

import numpy as np
import pytest

from trunk_msgs_util.mechanics import Body, inverse_dynamics
from trunk_sim.plant import PlantState, accelerations


@pytest.mark.parametrize("prescribed", [False, True], ids=["passive", "prescribed"])
def test_inverse_dynamics_invert_the_plant(prescribed):
    rng = np.random.default_rng(3)
    for _ in range(2000):
        constants = (*rng.uniform(0.1, 5.0, 6).tolist(), prescribed)
        x, theta, x_dot, theta_dot = rng.uniform(-4.0, 4.0, 4).tolist()
        wanted = float(rng.normal(0.0, 30.0))
        inertia, bias = inverse_dynamics(x, theta, x_dot, theta_dot, Body(*constants))
        torque = inertia * wanted + bias
        state = PlantState(x, theta, x_dot, theta_dot)
        _, found = accelerations(state, 0.0, torque, Body(*constants))
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9 * (1.0 + abs(bias) / inertia))
