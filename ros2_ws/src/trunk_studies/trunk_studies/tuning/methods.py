"""Gains for an unstable, undamped plant: pole placement, LQR, and a relay experiment for Ku and Tu."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf, pi, radians, sqrt
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are
from scipy.optimize import brentq
from scipy.signal import place_poles

from trunk_control.pid_family import Gains
from trunk_core.arrays import Floats
from trunk_core.errors import TuningError
from trunk_core.parameters.declarations import Value
from trunk_core.units import seconds
from trunk_runs.plan import RunPlan

from .linear import STEP, Linear, linearise, linearised


def pole_gains(plan: RunPlan, poles: Sequence[float] = (-12.0, -8.0, -2.0)) -> dict[str, Value]:
    """Return the gains that put the poles of a plan's loop, 1/s, as its controller's parameters.

    Behind computed_torque the plant is a double integrator. Raises TuningError as `by_poles` does.
    """
    plant = linearise(plan.simulator)
    if plan.controller_name == "computed_torque":
        plant = plant._replace(a=0.0, b=1.0)
    return gain_values(by_poles(plant, poles))


def riccati_gains(
    plan: RunPlan,
    integral: float = 0.1,
    angle: float = radians(6.0),
    speed: float = 1.0,
    torque: float = 5.0,
    *,
    discrete: bool = False,
) -> dict[str, Value]:
    """Return the parameters of a plan's lqr by the largest acceptable values; see `by_lqr`.

    ``discrete``: for a torque that is held over each period of the controller. Raises TuningError.
    """
    plant = linearise(plan.simulator)
    period = seconds(plan.controller.period_ns) if discrete else 0.0
    gains = by_lqr(plant, integral, angle, speed, torque, period)
    return {**gain_values(gains), "model.gravity_torque": plant.a / plant.b}


def feedback_gains(
    plan: RunPlan,
    position: float = 0.3,
    angle: float = radians(6.0),
    velocity: float = 1.0,
    speed: float = 1.0,
    torque: float = 5.0,
    *,
    discrete: bool = False,
) -> dict[str, Value]:
    """Return the parameters of a plan's state_feedback by the largest acceptable values; see `by_state`.

    ``position``, ``velocity``: of the coordinate that is not controlled. ``discrete``: as for
    `riccati_gains`. Raises TuningError.
    """
    simulator, kind = plan.simulator, plan.simulator.kind
    constants, friction = kind.level(simulator.constants), simulator.viscous_friction
    a, b = linearised(kind.accelerations, constants, kind.rest, kind.drive, friction)
    period = seconds(plan.controller.period_ns) if discrete else 0.0
    x, p, v, d = by_state(a, b, (position, angle, velocity, speed), torque, period)
    return {**gain_values(Gains(p, 0.0, d)), "gains.x": x, "gains.v": v}


# Which gains of which law are those of an LQR, by a plan and the largest acceptable values.
RICCATI: Mapping[str, Callable[..., dict[str, Value]]] = {
    "lqr": riccati_gains,
    "state_feedback": feedback_gains,
}


def gain_values(gains: Gains) -> dict[str, Value]:
    """Return gains as parameters."""
    return {f"gains.{name}": getattr(gains, name) for name in "pid"}


def _with_integral(plant: Linear) -> tuple[Floats, Floats]:
    """Return A, B of the states (integral of theta, theta, theta')."""
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, plant.a, -plant.c]])
    return a, np.array([[0.0], [0.0], [plant.b]])


def by_poles(plant: Linear, poles: Sequence[float]) -> Gains:
    """Return the PID gains that put the poles of the loop in continuous time, 1/s.

    Three distinct poles left of zero, or two for a PD (Ki = 0). Raises TuningError for others.
    """
    if len(poles) not in (2, 3) or len(set(poles)) < len(poles) or max(poles) >= 0.0:
        raise TuningError(f"poles {list(poles)}: give two or three distinct negative numbers, 1/s")
    a, b = _with_integral(plant)
    skip = 3 - len(poles)
    k = place_poles(a[skip:, skip:], b[skip:], np.array(poles)).gain_matrix[0].tolist()
    i, p, d = [0.0] * skip + k
    return Gains(p, i, d)


def by_lqr(
    plant: Linear, integral: float, angle: float, rate: float, torque: float, period: float = 0.0
) -> Gains:
    """Return the LQR gains with integral action, weights by the largest acceptable values.

    They minimise ``integral (I^2/I_0^2 + e^2/e_0^2 + e'^2/w_0^2 + u^2/u_0^2) dt``: I_0 in rad s,
    e_0 in rad, w_0 in rad/s, u_0 in the drive's unit, each positive. With a ``period`` h [s] they do so
    for a torque held over each period and the law's own integral ``I_k = I_{k-1} + h e_k`` (`sampled`).
    Raises TuningError if they are so far apart that the Riccati equation cannot be solved in floating point.
    """
    if min(integral, angle, rate, torque) <= 0.0:
        raise TuningError("the weights' values must be greater than 0")
    a, b = _with_integral(plant)
    try:
        gains, _ = _optimal(a, b, (integral, angle, rate), torque, period, summed=True)
    except (ValueError, np.linalg.LinAlgError):
        values = ", ".join(f"{value:g}" for value in (integral, angle, rate, torque))
        raise TuningError(
            f"no LQR gains for the largest values {values} (integral of the error, error, its rate, command; "
            "SI): choose values closer to one another"
        ) from None
    i, p, d = gains
    return Gains(p, i, d)


def by_state(
    a: Floats, b: Floats, largest: Sequence[float], effort: float, period: float = 0.0
) -> list[float]:
    """Return the LQR gains K [4] of ``u = -K z`` for ``z' = A z + B u``, z = (x, theta, x', theta').

    They minimise ``integral (sum_k z_k^2 / largest_k^2 + u^2 / effort^2) dt``, with a ``period`` h [s] for a
    command that is held over each period; A [4, 4] and B [4] as `linearised` gives them. Raises TuningError
    if the command cannot bring both coordinates to rest, and as `by_lqr` does.
    """
    if min(*largest, effort) <= 0.0:
        raise TuningError("the weights' values must be greater than 0")
    try:
        gains, loop = _optimal(a, b[:, None], largest, effort, period)
        modes = np.linalg.eigvals(loop)
        if np.max(np.abs(modes) - 1.0 if period > 0.0 else modes.real) < 0.0:
            return gains
    except (ValueError, np.linalg.LinAlgError):
        pass
    if not controllable(a, b):
        raise TuningError(
            "no gains of state_feedback hold both coordinates of this plant at rest: its command cannot move "
            "one without the other (not controllable); lqr holds the angle alone"
        )
    values = ", ".join(f"{value:g}" for value in (*largest, effort))
    raise TuningError(
        f"no LQR gains for the largest values {values} (position, angle, their rates, command; SI): choose "
        "values closer to one another"
    )


def controllable(a: Floats, b: Floats) -> bool:
    """Return True if the input of ``z' = A z + B u`` reaches every state, by the rank of (B, AB, A^2 B ...).

    Time is scaled by A's largest eigenvalue and each state by its row, so that units do not matter; what
    central differences leave of a zero does not count.
    """
    pace = max(float(np.max(np.abs(np.linalg.eigvals(a)))), STEP)
    columns = [b]
    for _ in a[1:]:
        columns.append(a @ columns[-1] / pace)
    reached = np.column_stack(columns)
    size = np.max(np.abs(reached), axis=1, keepdims=True)
    return bool(np.all(size > 0.0) and np.linalg.matrix_rank(reached / size, tol=STEP) == len(a))


def _optimal(
    a: Floats,
    b: Floats,
    largest: Sequence[float],
    effort: float,
    period: float,
    *,
    summed: bool = False,
) -> tuple[list[float], Floats]:
    """Return the gains of the Riccati equation, and ``A - B K``, over a ``period`` if that is not 0.

    ``summed``: as `sampled` has it.
    """
    q = np.diag([value**-2 for value in largest])
    r = np.array([[effort**-2]])
    if period > 0.0:
        a, b, q, n, r = sampled(a, b, q, r, period, summed)
        cost = solve_discrete_are(a, b, q, r, s=n)
        gains: Floats = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a + n.T)
    else:
        gains = np.linalg.solve(r, b.T @ solve_continuous_are(a, b, q, r))
    return gains[0].tolist(), a - b @ gains


def sampled(
    a: Floats, b: Floats, q: Floats, r: Floats, h: float, summed: bool = False
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return A, B, Q, N, R over a period h [s] of ``x' = A x + B u`` with the cost ``x'Qx + u'Ru``, u held.

    The cost of a period is ``x'Qx + 2x'Nu + u'Ru`` (C. F. Van Loan, Computing integrals involving the
    matrix exponential, IEEE Trans. Automatic Control 23 (1978)). ``summed``: the first state is the law's
    sum, which adds h times the second, the angle, at the period's end.
    """
    n = len(a)
    motion = np.block([[a, b], [np.zeros((1, n + 1))]])
    weights = np.block([[q, np.zeros((n, 1))], [np.zeros((1, n)), r]])
    joined = expm(np.block([[-motion.T, weights], [np.zeros_like(motion), motion]]) * h)
    over = joined[n + 1 :, n + 1 :]
    cost = over.T @ joined[: n + 1, n + 1 :]
    ad, bd = over[:n, :n], over[:n, n:]
    if summed:
        ad[0] = h * ad[1]
        ad[0, 0] += 1.0
        bd[0] = h * bd[1]
    return ad, bd, cost[:n, :n], cost[:n, n:], cost[n:, n:]


class Relay(NamedTuple):
    """What a relay experiment found, and what follows from the characteristic polynomial."""

    gain: Annotated[float, "Ku = 4 d / (pi amplitude), N m/rad: the describing function's"]
    period: Annotated[float, "Tu of the limit cycle, s"]
    amplitude: Annotated[float, "Of the limit cycle, rad"]
    exact_gain: Annotated[float, "Routh: where pure P loses stability, N m/rad"]
    exact_period: Annotated[float, "Likewise, s"]

    @property
    def overrides(self) -> dict[str, Value]:
        """Table 1's PID gains, for a plan."""
        gains = gain_values(ziegler_nichols(self.gain, self.period))
        return {f"pid.{name}": value for name, value in gains.items()}


def ultimate(plant: Linear) -> tuple[float, float]:
    """Return the gain [N m/rad] and period [s] at the stability limit of pure P.

    With a lag T and damping c, ``T s^3 + (1 + T c) s^2 + (c - T a) s + (b K - a)`` has an imaginary
    pair at ``w^2 = (c - T a) / T`` and ``b K = a + (1 + T c) w^2``. Raises TuningError if there is
    none: without a lag or with too little damping, pure P is stable for no gain or for all.
    """
    if plant.lag <= 0.0 or plant.c <= plant.lag * plant.a:
        raise TuningError(
            "no ultimate gain: it needs an actuator lag > 0 s and a damping > "
            f"{plant.lag * plant.a / plant.b:.4g} (SI); declare both"
        )
    square = plant.c / plant.lag - plant.a
    return (plant.a + (1.0 + plant.lag * plant.c) * square) / plant.b, 2.0 * pi / sqrt(square)


def relay(plant: Linear, amplitude: float, steps: int = 1000, cycles: int = 60) -> Relay:
    """Return the response of the trunk to a relay of +-``amplitude`` N m in place of the controller.

    Astrom and Hagglund's experiment on the linear plant, computed exactly: the torque is constant between
    switchings, which are located where the angle passes 0. The last cycles of ``cycles`` are measured, at
    ``steps`` points of each expected period. Raises TuningError if no limit cycle settles.
    """
    exact_gain, exact_period = ultimate(plant)
    step = exact_period / steps
    a, b = plant.matrices()
    n = len(a)
    motion = np.block([[a, b], [np.zeros((1, n + 1))]])
    over = expm(motion * step)
    # Within what the relay can hold against gravity, near the describing function's prediction.
    state = np.zeros(n + 1)
    state[0] = 2.0 * amplitude / (pi * exact_gain)
    state[n] = -amplitude
    time = peak = 0.0
    crossings: list[float] = []
    peaks: list[float] = []
    for _ in range(cycles * steps):
        after = over @ state
        peak = max(peak, abs(after[0]))
        if not peak < 100.0 * amplitude / exact_gain:
            raise TuningError("the relay's oscillation grows without bound: no limit cycle")
        if after[0] * state[n] < 0.0:  # the torque opposes the angle
            time, state = time + step, after
            continue

        def angle(t: float, start: Floats = state) -> float:
            return float((expm(motion * t) @ start)[0])

        passed = (
            brentq(angle, 0.0, step, xtol=1e-12 * step) if angle(0.0) * after[0] < 0.0 else step
        )
        time, state = time + passed, expm(motion * passed) @ state
        state[n] = -state[n]
        if state[n] < 0.0:  # upwards
            crossings.append(time)
            peaks.append(peak)
            peak = 0.0
            if np.ptp(np.diff(crossings)[-5:] if len(crossings) > 5 else [0.0, inf]) < 1e-9 * time:
                break
    periods = np.diff(crossings)[-5:]
    if len(periods) < 5 or np.ptp(periods) > 0.01 * float(np.mean(periods)):
        raise TuningError("the relay's oscillation does not settle to a limit cycle")
    swing = float(np.mean(peaks[-5:]))
    gain = 4.0 * amplitude / (pi * swing)
    return Relay(gain, float(np.mean(periods)), swing, exact_gain, exact_period)


def ziegler_nichols(gain: float, period: float) -> Gains:
    """Return Table 1's PID: ``Kp = 0.6 Ku, Ti = Tu / 2, Td = Tu / 8``."""
    kp = 0.6 * gain
    return Gains(kp, kp / (period / 2.0), kp * period / 8.0)
