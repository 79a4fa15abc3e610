"""Gains for an unstable, undamped plant: pole placement, LQR, and a relay experiment for Ku and Tu."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, pi, sqrt
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are
from scipy.optimize import brentq
from scipy.signal import place_poles

from trunk_control.pid_family import Gains
from trunk_msgs_util.parameters.declarations import Value
from trunk_msgs_util.recording.joint_table import Floats

from ..errors import TuningError
from .linear import Linear


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
    e_0 in rad, w_0 in rad/s, u_0 in N m, each positive. With a ``period`` h [s] they do so for a torque
    held over each period and the law's own integral ``I_k = I_{k-1} + h e_k`` (`sampled`). Raises
    TuningError if they are so far apart that the Riccati equation cannot be solved in floating point.
    """
    if min(integral, angle, rate, torque) <= 0.0:
        raise TuningError("the weights' values must be greater than 0")
    a, b = _with_integral(plant)
    q = np.diag([integral**-2, angle**-2, rate**-2])
    r = np.array([[torque**-2]])
    try:
        if period > 0.0:
            a, b, q, n, r = sampled(a, b, q, r, period)
            cost = solve_discrete_are(a, b, q, r, s=n)
            gains = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a + n.T)
        else:
            gains = np.linalg.solve(r, b.T @ solve_continuous_are(a, b, q, r))
    except (ValueError, np.linalg.LinAlgError):
        raise TuningError(
            f"no LQR gains for an integral of {integral:g} rad s, an error of {angle:g} rad, a rate of "
            f"{rate:g} rad/s and a torque of {torque:g} N m: choose values closer to one another"
        ) from None
    i, p, d = gains[0].tolist()
    return Gains(p, i, d)


def sampled(
    a: Floats, b: Floats, q: Floats, r: Floats, h: float
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return A, B, Q, N, R over a period h [s] of ``x' = A x + B u`` with the cost ``x'Qx + u'Ru``, u held.

    The cost of a period is ``x'Qx + 2x'Nu + u'Ru`` (C. F. Van Loan, Computing integrals involving the
    matrix exponential, IEEE Trans. Automatic Control 23 (1978)). The first state is the law's sum, which
    adds h times the angle at the period's end.
    """
    n = len(a)
    motion = np.block([[a, b], [np.zeros((1, n + 1))]])
    weights = np.block([[q, np.zeros((n, 1))], [np.zeros((1, n)), r]])
    joined = expm(np.block([[-motion.T, weights], [np.zeros_like(motion), motion]]) * h)
    over = joined[n + 1 :, n + 1 :]
    cost = over.T @ joined[: n + 1, n + 1 :]
    ad, bd = over[:n, :n], over[:n, n:]
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
        gains = ziegler_nichols(self.gain, self.period)
        return {f"pid.gains.{name}": getattr(gains, name) for name in "pid"}


def ultimate(plant: Linear) -> tuple[float, float]:
    """Return the gain [N m/rad] and period [s] at the stability limit of pure P.

    With a lag T and damping c, ``T s^3 + (1 + T c) s^2 + (c - T a) s + (b K - a)`` has an imaginary
    pair at ``w^2 = (c - T a) / T`` and ``b K = a + (1 + T c) w^2``. Raises TuningError if there is
    none: without a lag or with too little damping, pure P is stable for no gain or for all.
    """
    if plant.lag <= 0.0 or plant.c <= plant.lag * plant.a:
        raise TuningError(
            "no ultimate gain: it needs an actuator lag > 0 s and a damping > "
            f"{plant.lag * plant.a / plant.b:.4g} N m s/rad (lag x m g l); declare both"
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
