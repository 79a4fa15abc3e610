"""The trunk linearised about the upright, hip prescribed, and the sampled loop around it.

``theta'' = a theta + b tau`` with a = g / l and b = 1 / (m l^2), taken from the plant's equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.optimize import brentq

from trunk_control.pid_family import Gains
from trunk_msgs_util.mechanics import Body
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_sim.plant import PlantState, accelerations

from ..errors import PlanError

Complexes = npt.NDArray[np.complex128]
_SMALL = 1e-6  # rad: the error of the difference quotient is of the order of its square


class Linear(NamedTuple):
    """``theta'' = a theta + b tau - c theta'``; ``lag``: time constant of the torque, s."""

    a: float  # 1/s^2
    b: float  # 1/(kg m^2)
    c: float = 0.0  # 1/s, declared damping, not the plant's
    lag: float = 0.0  # s

    def matrices(self) -> tuple[Floats, Floats]:
        """Return A, B of the states (theta, theta'), with a lag (theta, theta', tau)."""
        a = np.array([[0.0, 1.0, 0.0], [self.a, -self.c, self.b], [0.0, 0.0, 0.0]])
        if self.lag > 0.0:
            a[2, 2] = -1.0 / self.lag
            return a, np.array([[0.0], [0.0], [1.0 / self.lag]])
        return a[:2, :2], a[:2, 2:]


def linearise(plant: Body) -> Linear:
    """Return the plant's linearisation at theta = 0 with a hip that moves uniformly on level ground.

    Raises PlanError for a plant whose accelerations are not finite.
    """
    p = plant._replace(prescribed=True, as_printed=False, amplitude=0.0, harmonics=None)

    def response(theta: float, torque: float) -> float:
        return accelerations(PlantState(0.0, theta, 0.0, 0.0), 0.0, torque, p)[1]

    try:
        slope = (response(_SMALL, 0.0) - response(-_SMALL, 0.0)) / (2.0 * _SMALL)
        gain = response(0.0, 1.0)
    except ArithmeticError:
        slope = gain = nan
    if not (isfinite(slope) and isfinite(gain)):
        raise PlanError(
            f"the plant cannot be linearised: plant.length is {plant.length:g} m, "
            f"plant.trunk_mass {plant.trunk_mass:g} kg: too small for finite accelerations"
        )
    return Linear(slope, gain)


@dataclass(frozen=True)
class LinearLoop:
    """A sampled PID loop around the linearised trunk: period h, torque held, angle delayed.

    ``delay`` counts whole periods. ``rate``: the derivative is the measured rate, otherwise it is the
    difference of two samples of the angle.
    """

    plant: Linear
    gains: Gains
    h: float  # s
    rate: bool = True
    delay: int = 0

    def matrix(self) -> Floats:
        """Return the map of one period, on (plant, delayed angles and rates, integral, last angle)."""
        a, b = self.plant.matrices()
        n = len(a)
        held = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * self.h)
        size = n + 2 * self.delay + 2
        angle, speed = np.zeros(size), np.zeros(size)
        angle[n + 2 * (self.delay - 1) if self.delay else 0] = 1.0
        speed[n + 2 * (self.delay - 1) + 1 if self.delay else 1] = 1.0
        integral, last = np.eye(size)[-2], np.eye(size)[-1]
        kp, ki, kd = self.gains
        summed = integral - self.h * angle
        derivative = -speed if self.rate else (last - angle) / self.h
        torque = -kp * angle + ki * summed + kd * derivative
        step = np.zeros((size, size))
        step[:n, :n] = held[:n, :n]
        step[:n] += np.outer(held[:n, n], torque)
        for k in range(self.delay):
            source = n + 2 * (k - 1) if k else 0
            step[n + 2 * k, source] = step[n + 2 * k + 1, source + 1] = 1.0
        step[-2], step[-1] = summed, angle
        return step

    def radius(self) -> float:
        """Return the largest modulus of the map's eigenvalues; the loop is stable below 1.

        An integral without gain is left out: its eigenvalue 1 moves nothing.
        """
        step = self.matrix()
        if self.gains.i == 0.0:
            keep = [k for k in range(len(step)) if k != len(step) - 2]
            step = step[np.ix_(keep, keep)]
        if not np.all(np.isfinite(step)):
            return np.inf  # so long a period that the fall overflows
        return float(np.max(np.abs(np.linalg.eigvals(step))))

    @property
    def stable(self) -> bool:
        """True if every disturbance dies out."""
        return self.radius() < 1.0 - 1e-12

    def response(self, frequency: Floats) -> Complexes:
        """Return the open-loop frequency response L(e^(j w h)) at w in rad/s, cut at the torque."""
        a, b = self.plant.matrices()
        n = len(a)
        held = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * self.h)
        kp, ki, kd = self.gains
        z = np.exp(1j * frequency * self.h)
        inverted = z[:, None, None] * np.eye(n) - held[:n, :n]
        x = np.linalg.solve(inverted, held[:n, n : n + 1])[:, :, 0].T
        derivative = x[1] if self.rate else x[0] * (1.0 - 1.0 / z) / self.h
        integral = ki * self.h * z / (z - 1.0) * x[0]
        values: Complexes = (kp * x[0] + integral + kd * derivative) * z**-self.delay
        return values

    def crossovers(self) -> Floats:
        r"""Return the frequencies in rad/s at which \|L\| passes 1, lowest first."""
        grid = self.frequencies()
        above = np.log(np.abs(self.response(grid)))

        def level(w: float) -> float:
            return float(np.log(np.abs(self.response(np.array([w]))[0])))

        passes = np.flatnonzero(np.diff(np.sign(above)))
        return np.array([brentq(level, grid[k], grid[k + 1], xtol=1e-12) for k in passes])

    def frequencies(self) -> Floats:
        """Return a grid in rad/s up to the Nyquist frequency, over six decades."""
        nyquist = np.pi / self.h
        return np.geomspace(1e-6 * nyquist, 0.9999 * nyquist, 8000).astype(np.float64)


class Margins(NamedTuple):
    """How far a sampled loop is from instability."""

    gain_up: float  # factor on all gains at which it loses stability; infinite where it never does
    gain_down: float  # the same, downwards; 0 where it never does
    phase_deg: float
    modulus: float  # 1 / peak sensitivity: the smallest distance of L from -1
    delay: float  # s, the largest that it tolerates, in whole periods


def margins(loop: LinearLoop) -> Margins:
    """Return a stable loop's margins. Raises ValueError if it is not stable.

    Gain margins are found by bisection on the loop's eigenvalues, the phase margin at the crossovers of
    the frequency response, the modulus margin on a grid of 8000 frequencies.
    """
    if not loop.stable:
        raise ValueError("the loop is unstable: it has no margins")
    crossing = loop.response(loop.crossovers())
    phase = np.abs(np.degrees(np.angle(-crossing)))
    return Margins(
        _edge(loop, 1.0, 1e4),
        _edge(loop, 1.0, 1e-4),
        float(np.min(phase)) if len(phase) else np.inf,
        float(np.min(np.abs(1.0 + loop.response(loop.frequencies())))),
        largest_delay(loop) * loop.h,
    )


def largest_delay(loop: LinearLoop, limit: int = 400) -> int:
    """Return how many periods of delay the loop tolerates on top of its own, up to a limit.

    A delay changes only the phase: an eigenvalue leaves the unit circle first at the crossover whose phase
    margin is used up first. The loop's eigenvalues decide on which side of that delay a whole period lies.
    """
    w = loop.crossovers()
    left = np.mod(np.angle(loop.response(w)) + np.pi, 2.0 * np.pi) / (w * loop.h)
    delay = int(min(np.min(left, initial=np.inf), limit))
    while delay > 0 and not _delayed(loop, delay).stable:
        delay -= 1
    while delay < limit and _delayed(loop, delay + 1).stable:
        delay += 1
    return delay


def _delayed(loop: LinearLoop, extra: int) -> LinearLoop:
    return LinearLoop(loop.plant, loop.gains, loop.h, loop.rate, loop.delay + extra)


def _edge(loop: LinearLoop, inside: float, outside: float) -> float:
    """Return the factor on all gains at which stability ends, between 1 and ``outside``."""

    def stable(factor: float) -> bool:
        gains = Gains(*(factor * gain for gain in loop.gains))
        return LinearLoop(loop.plant, gains, loop.h, loop.rate, loop.delay).stable

    steps = np.geomspace(inside, outside, 200)
    unstable = next((float(f) for f in steps[1:] if not stable(float(f))), None)
    if unstable is None:
        return np.inf if outside > 1.0 else 0.0
    good = float(steps[list(steps).index(unstable) - 1])
    for _ in range(50):
        middle = (good * unstable) ** 0.5
        good, unstable = (middle, unstable) if stable(middle) else (good, middle)
    return good
