"""The controller's inverse dynamics invert the plant's accelerations: two solutions of one Lagrangian."""

import numpy as np
import pytest

from trunk_core.mechanics import Body, inverse_dynamics
from trunk_sim.plant import PlantState
from trunk_sim.plants.trunk import passive, prescribed


@pytest.mark.parametrize("equations", [passive, prescribed])
def test_inverse_dynamics_invert_the_plant(equations):
    rng = np.random.default_rng(3)
    for _ in range(2000):
        body = Body(*rng.uniform(0.1, 5.0, 6).tolist())
        x, theta, x_dot, theta_dot = rng.uniform(-4.0, 4.0, 4).tolist()
        wanted = float(rng.normal(0.0, 30.0))
        walks = equations is prescribed
        inertia, bias = inverse_dynamics(x, theta, x_dot, theta_dot, body, walks)
        torque = inertia * wanted + bias
        state = PlantState(x, theta, x_dot, theta_dot)
        _, found = equations(state, 0.0, torque, body)
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9 * (1.0 + abs(bias) / inertia))
