"""The classical Runge-Kutta method, order 4, fixed step, for the plant's four states.

Pure: runs in CPython and compiles with numba unchanged.
"""

from __future__ import annotations

from trunk_msgs_util.mechanics import Body

from .plant import PlantState, accelerations


def rk4_step(
    state: PlantState, hip_force: float, torque: float, h: float, body: Body
) -> PlantState:
    """Return the state after one step of ``h`` seconds, the inputs [N, N m] held over it.

    Local error O(h^5), global O(h^4).
    """
    x, theta, v, w = state
    half = 0.5 * h
    a1, b1 = accelerations(state, hip_force, torque, body)
    v2, w2 = v + half * a1, w + half * b1
    a2, b2 = accelerations(
        PlantState(x + half * v, theta + half * w, v2, w2), hip_force, torque, body
    )
    v3, w3 = v + half * a2, w + half * b2
    a3, b3 = accelerations(
        PlantState(x + half * v2, theta + half * w2, v3, w3), hip_force, torque, body
    )
    v4, w4 = v + h * a3, w + h * b3
    a4, b4 = accelerations(PlantState(x + h * v3, theta + h * w3, v4, w4), hip_force, torque, body)
    sixth = h / 6.0
    return PlantState(
        x + sixth * (v + 2.0 * (v2 + v3) + v4),
        theta + sixth * (w + 2.0 * (w2 + w3) + w4),
        v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        w + sixth * (b1 + 2.0 * (b2 + b3) + b4),
    )


def advance(
    state: PlantState,
    hip_force: float,
    torque: float,
    period: float,
    substeps: int,
    body: Body,
) -> PlantState:
    """Return the state after one control period, integrated in ``substeps`` equal RK4 steps."""
    h = period / substeps
    for _ in range(substeps):
        state = rk4_step(state, hip_force, torque, h, body)
    return state
