"""The loop of plant, sampled law and delays, linearised at rest: a trunk's upright, its hip on level ground.

Plant and law are linearised by central differences of the functions that run them (`act`, the law's
``update``). So whatever these do to small signals is in it: derivative mode and filter, gains of a rule
base at the origin, a drive's lag, viscous friction, delays of the sensors, a control rate below the plant's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf, nan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from trunk_control.law import Constants, ControllerConfig, Hip, Law, LawMemory, Limits, Sample
from trunk_control.laws import law_of
from trunk_core.arrays import Floats
from trunk_core.errors import NotInstalledError, PlanError
from trunk_core.units import seconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import Accelerations, PlantState
from trunk_sim.step import Actuator, Dynamics, PlantConstants, PlantStatus, act

from ..batch.lanes import made_of, numbers_in, without_row

if TYPE_CHECKING:
    from control import StateSpace

Complexes = npt.NDArray[np.complex128]
STEP = 1e-6  # of the differences, SI: their error is of the order of its square
STABLE = 1.0 - 1e-9  # spectral radius; closer to 1 than the differences are exact is not stable
_SETTLED = 4  # updates at rest after which a law's memory no longer changes its kind
_QUIET = Disturbance()
_HELD, _DRIVE = 1, 4  # of the states x, theta, x', theta' and the drive's effort


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


def linearised(
    accelerations: Accelerations,
    constants: Any,
    rest: PlantState,
    drive: int,
    friction: float = 0.0,
    step: float = STEP,
) -> tuple[Floats, Floats]:
    """Return A [4, 4] and B [4] of ``z' = A z + B u``, z = (x, theta, x', theta') minus the state at rest.

    The command u pushes the coordinate ``drive``, 0 or 1, and ``friction`` b slows it: the force on it is
    ``u - b z[2 + drive]``, in N and N s/m where it slides, in N m and N m s/rad where it turns. By central
    differences of this ``step``; accelerations are affine in forces. Raises PlanError for ones not finite.
    """

    def moved(values: Floats, push: float = 0.0) -> tuple[float, float]:
        forces = (push, 0.0) if drive == 0 else (0.0, push)
        return accelerations(PlantState(*values.tolist()), *forces, constants)

    at = np.array(rest)
    try:
        slopes = _slopes(moved, at, step)
        gains = (np.array(moved(at, 1.0)) - np.array(moved(at, -1.0))) / 2.0
    except ArithmeticError:
        slopes, gains = np.full((2, 4), nan), np.full(2, nan)
    a = np.vstack([np.eye(4)[2:], slopes])
    b = np.concatenate([np.zeros(2), gains])
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        raise PlanError(
            f"the plant cannot be linearised: its accelerations at rest are not finite with {constants}"
        )
    a[:, 2 + drive] -= friction * b
    return a, b


def linearise(simulator: SimulatorConfig) -> Linear:
    """Return a plant's linearisation with a first coordinate that moves uniformly: a hip on level ground.

    Raises PlanError for a plant that has no such equations, or whose accelerations are not finite.
    """
    kind = simulator.kind
    if kind.held is None:
        raise PlanError(
            f"plant.name: {kind.name}: its {kind.coordinates[0].joint} cannot be prescribed: use trunk tune "
            "lqr --controller state_feedback, or trunk tune optimise"
        )
    constants = kind.level(simulator.constants)
    a, b = linearised(kind.held, constants, kind.rest, kind.drive)
    return Linear(float(a[3, _HELD]), float(b[3]))


def linear_drive(actuator: Actuator | None) -> Actuator | None:
    """Return a drive without what has no slope at zero: dead band, resolution, bias, Coulomb friction."""
    if actuator is None:
        return None
    return actuator._replace(dead_band=0.0, resolution=0.0, bias=0.0, coulomb=0.0)


def left_out(simulator: SimulatorConfig) -> Iterator[str]:
    """Yield a warning for each part of a plant that a linear model leaves out."""
    if simulator.network is not None:
        yield "link.state, link.command and sensor.dropout are left out of the linear model"
    if simulator.actuator is not None and simulator.actuator != linear_drive(simulator.actuator):
        yield (
            "actuator.dead_band, resolution, bias and coulomb_friction are left out of the linear model: "
            "they have no slope at zero"
        )


@dataclass(frozen=True)
class LinearLoop:
    """A plant and a controller, sampled with the period ``h`` [s], a command u [N m] held between samples.

    ::

        x(k+1) = A x(k) + B u(k),     y(k) = C x(k-d) + D u(k-d)      plant, d periods of delay
        z(k+1) = F z(k) + G (y(k), r(k)),     u(k) = f (H z(k) + J (y(k), r(k)))     controller

    x: the plant's coordinates, their rates and the drive's torque [n]: angle, rate and torque, and what else
    the law or the angle depends on; y: what is measured of it, all but the torque; z: what the law remembers
    and its command depends on [m]; r: the reference, rad; f: a factor on all gains.
    """

    a: Floats  # [n, n]
    b: Floats  # [n]
    c: Floats  # [n - 1, n]
    d: Floats  # [n - 1], 0 without delay
    memory: Floats  # F [m, m]
    input: Floats  # G [m, n]
    output: Floats  # H [m]
    direct: Floats  # J [n]
    h: float
    delay: int = 0
    held: int = 0  # the angle's place in x
    factor: float = 1.0

    def matrix(self) -> Floats:
        """Return the map of one period, on (plant, law, torques under way)."""
        return self._maps()[0]

    def _maps(self) -> tuple[Floats, Floats]:
        """Return the map of one period [size, size], and what a reference adds to it [size]."""
        n, m = len(self.b), len(self.output)
        size = n + m + self.delay + 1  # the last: the reference
        state, memory = np.eye(size)[:n], np.eye(size)[n : n + m]
        underway, reference = np.eye(size)[n + m : -1], np.eye(size)[-1:]
        torque: Floats = underway[-1] if self.delay else np.zeros(size)
        read = np.vstack([self.c @ state + np.outer(self.d, torque), reference])
        command = self.factor * (self.output @ memory + self.direct @ read)
        if not self.delay:
            torque = command
        after: list[Floats] = [
            self.a @ state + np.outer(self.b, torque),
            self.memory @ memory + self.input @ read,
        ]
        if self.delay:
            after.append(np.vstack([command, underway[:-1]]))
        step = np.vstack(after)
        return step[:, :-1], step[:, -1]

    def step_response(self, count: int) -> Floats:
        """Return the angle over ``count`` periods after a step of the reference from 0 to 1, at rest."""
        step, reference = self._maps()
        state: Floats = np.zeros(len(step))
        angles = []
        for _ in range(count + self.delay):
            angles.append(float(state[self.held]))
            state = step @ state + reference
        return np.array(
            angles[self.delay :]
        )  # the map delays the torque in place of what is measured

    def radius(self) -> float:
        """Return the largest modulus of the map's eigenvalues; the loop is stable below 1."""
        if not np.all(np.isfinite(self.a)):
            return inf  # so long a period that the fall overflows
        step = self.matrix()
        return float(np.max(np.abs(np.linalg.eigvals(step))))

    @property
    def stable(self) -> bool:
        """True if every disturbance dies out."""
        return self.radius() < STABLE

    def response(self, frequency: Floats) -> Complexes:
        """Return the open-loop frequency response L(e^(j w h)) at w in rad/s, cut at the torque.

        ::

            L(z) = -f (H (z - F)^-1 G + J) (C (z - A)^-1 B + D) z^-d
        """
        z = np.exp(1j * frequency * self.h)
        plant = _transfer(z, self.a, self.b[:, None], self.c, self.d[:, None])
        law = _transfer(
            z, self.memory, self.input[:, :-1], self.output[None, :], self.direct[None, :-1]
        )
        values: Complexes = -self.factor * (law @ plant)[:, 0, 0] * z**-self.delay
        return values

    def to_control(self) -> StateSpace:
        """Return L, the open loop of `response`, for python-control: discrete, its ``dt`` h [s].

        Raises NotInstalledError without python-control.
        """
        try:
            from control import ss
        except ImportError:
            raise NotInstalledError(
                "python-control is not installed: pip install trunk_experiments[control]"
            ) from None
        plant = ss(self.a, self.b[:, None], self.c, self.d[:, None], self.h)
        law = ss(
            self.memory, self.input[:, :-1], self.output[None, :], self.direct[None, :-1], self.h
        )
        n = self.delay
        late = ss(np.eye(n, k=-1), np.eye(n, 1), np.eye(1, n, n - 1), not n, self.h)
        return -self.factor * law * late * plant

    def crossovers(self) -> Floats:
        r"""Return the frequencies in rad/s at which \|L\| passes 1, lowest first."""
        grid = self.frequencies()
        above = np.log(np.abs(self.response(grid)))

        def log_gain(w: float) -> float:
            return float(np.log(np.abs(self.response(np.array([w]))[0])))

        passes = np.flatnonzero(np.diff(np.sign(above)))
        return np.array([brentq(log_gain, grid[k], grid[k + 1], xtol=1e-12) for k in passes])

    def frequencies(self) -> Floats:
        """Return a grid in rad/s up to the Nyquist frequency, over six decades."""
        nyquist = np.pi / self.h
        return np.geomspace(1e-6 * nyquist, 0.9999 * nyquist, 8000).astype(np.float64)


def _transfer(z: Complexes, a: Floats, b: Floats, c: Floats, d: Floats) -> Complexes:
    """Return ``C (z - A)^-1 B + D`` for each z."""
    shifted = z[:, None, None] * np.eye(len(a)) - a
    values: Complexes = (c @ np.linalg.solve(shifted, b + 0j) + d).astype(np.complex128)
    return values


def loop_of(
    simulator: SimulatorConfig,
    config: ControllerConfig,
    accelerations: Accelerations | None = None,
) -> LinearLoop:
    """Return the loop of a plant at rest, the trunk's on level ground, and a controller.

    ``accelerations``: by default those with which the first coordinate keeps its rate, where the plant has
    them, else the plant's. A coordinate on which neither the law nor the held angle depends is left out.
    Raises PlanError where the loop cannot be linearised.
    """
    kind = simulator.kind
    accelerations = accelerations or kind.held or kind.accelerations
    constants, rest = kind.level(simulator.constants), kind.rest
    linearised(
        accelerations, constants, rest, kind.drive
    )  # says so if it is the plant that cannot be
    plant = simulator.plant._replace(
        constants=constants,
        max_effort=inf,
        fall_angle=inf,
        actuator=linear_drive(simulator.actuator),
    )
    try:
        a, b = _plant_step(plant, Dynamics(simulator.dynamics.forces, accelerations), rest)
    except ArithmeticError:
        a = np.array(inf)
    if not np.all(np.isfinite(a)):  # so long a period that the fall overflows
        a, b = np.full((5, 5), inf), np.zeros(5)
    dt, hip = seconds(config.period_ns), Hip(rest.x)
    law = law_of(config)
    (slopes,) = law_slopes(law, config.constants, config.limits, dt, [hip], rest.theta)
    m = len(slopes) - 1
    # A model's hip is on its path: level ground has none.
    place = None if config.hip is None or law.plant else simulator.joints.index(config.hip)
    read = slopes[:, m:] @ _reading(place)
    depended = np.flatnonzero(np.any(read[:, :_DRIVE] != 0.0, axis=0)).tolist()
    kept = sorted({*observed(a, [_HELD, *depended]), _DRIVE})
    a, b, read = a[np.ix_(kept, kept)], b[kept], read[:, kept]  # the reference in the drive's place
    n = len(kept)
    every = max(1, round(config.period_ns / simulator.period_ns))
    # The sensors' delay in whole control periods, and what is left: so many plant periods before a sample.
    whole, early = divmod(simulator.delay_steps, every)
    c: Floats = np.eye(n)[:-1]
    d: Floats = np.zeros(n - 1)
    if early:
        before, held = _power(a, b, every - early)
        c, d, whole = c @ before, c @ held, whole + 1
    return LinearLoop(
        *_power(a, b, every),
        c,
        d,
        *_remembered(slopes[:m, :m], read[:m], slopes[m, :m], read[m]),
        seconds(every * simulator.period_ns),
        whole,
        kept.index(_HELD),
    )


def _plant_step(
    plant: PlantConstants, dynamics: Dynamics, rest: PlantState
) -> tuple[Floats, Floats]:
    """Return A [5, 5] and B [5] over one period of the plant, of its state and the drive's effort."""

    def step(values: Floats) -> tuple[float, ...]:
        *state, torque, effort = values.tolist()
        before = PlantStatus(PlantState(*state), torque, False, False)
        after = act(before, effort, _QUIET, plant, *dynamics)
        return (nan,) * 5 if after.diverged else (*after.state, after.effort)

    slopes = _slopes(step, np.array([*rest, 0.0, 0.0]))
    return slopes[:, :5], slopes[:, 5]


def _reading(hip: int | None) -> Floats:
    """Return where a law's inputs (angle, rate, reference, hip and its rate) come from [5, 5].

    By x, theta, x', theta' and the reference. ``hip``: which coordinate is its hip; None: it uses none.
    """
    reading = np.zeros((5, 5))
    reading[[0, 1, 2], [_HELD, 2 + _HELD, _DRIVE]] = 1.0
    if hip is not None:
        reading[[3, 4], [hip, 2 + hip]] = 1.0
    return reading


def law_slopes(
    law: Law,
    constants: Constants,
    limits: Limits,
    dt: float,
    hips: Sequence[Hip],
    angle: float = 0.0,
) -> Floats:
    """Return the Jacobians [hips, m + 1, m + 5] of a law's updates at rest, its limits out of the way.

    Of the m floats in its memory, and its command, by this memory, angle, rate, reference, hip and the hip's
    rate. ``angle``: where it rests, rad. The hip passes through ``hips``, period by period. Raises PlanError
    for a law that cannot be linearised.
    """
    limits = limits._replace(u_min=-inf, u_max=inf)

    def rest(hip: Hip) -> Sample:
        return Sample(angle, angle, 0.0, dt, hip)

    memory = law.memory
    if strange := without_row(memory):
        raise PlanError(f"{law.name} cannot be linearised: its {strange}, not a number")
    floats = [i for i, number in enumerate(numbers_in(memory)) if type(number) is float]

    def step(values: Floats, memory: LawMemory) -> tuple[float, ...]:
        *remembered, theta, rate, reference, position, velocity = values.tolist()
        numbers = numbers_in(memory)
        for i, number in zip(floats, remembered, strict=True):
            numbers[i] = number
        sample = Sample(reference, theta, rate, dt, Hip(position, velocity))
        after, terms = law.update(made_of(memory, iter(numbers)), sample, constants, limits)
        numbers = numbers_in(after)
        return (*(numbers[i] for i in floats), nan if terms.held else terms.effort)

    try:
        for k in range(-_SETTLED, 0):
            memory, _ = law.update(memory, rest(hips[k % len(hips)]), constants, limits)
        slopes = []
        for hip in hips:
            at = numbers_in(memory)
            kept = np.array([*(at[i] for i in floats), angle, 0.0, angle, *hip])
            slopes.append(_slopes(partial(step, memory=memory), kept))
            memory, _ = law.update(memory, rest(hip), constants, limits)
            after = numbers_in(memory)
            if any(at[i] != after[i] for i in set(range(len(at))).difference(floats)):
                raise PlanError(
                    f"{law.name} cannot be linearised: whole numbers or flags in its memory change from "
                    "update to update at rest"
                )
    except ArithmeticError:
        slopes = [np.array(nan)]
    if not np.all(np.isfinite(slopes)):
        raise PlanError(
            f"{law.name} cannot be linearised about the upright: its command is not finite there"
        )
    return np.array(slopes)


def _slopes(
    function: Callable[[Floats], tuple[float, ...]], at: Floats, step: float = STEP
) -> Floats:
    """Return the Jacobian of a function [outputs, inputs] by central differences."""
    columns = []
    for direction in np.eye(len(at)) * step:
        above, below = function(at + direction), function(at - direction)
        columns.append((np.array(above) - np.array(below)) / (2.0 * step))
    return np.array(columns).T


def _power(a: Floats, b: Floats, steps: int) -> tuple[Floats, Floats]:
    """Return A and B over several steps, the input held."""
    size = len(a)
    joined = np.eye(size + 1)
    joined[:size, :size], joined[:size, size] = a, b
    over = np.linalg.matrix_power(joined, steps)
    return over[:size, :size], over[:size, size]


def _remembered(
    f: Floats, g: Floats, h: Floats, j: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return a law without what its command does not depend on, such as an integral without a gain."""
    kept = observed(f, np.flatnonzero(h).tolist())
    return f[np.ix_(kept, kept)], g[kept], h[kept], j


def observed(step: Floats, seen: list[int]) -> list[int]:
    """Return the states that those ``seen`` depend on in a linear map, and they themselves, in order."""
    kept = set(seen)
    while more := {int(k) for i in kept for k in np.flatnonzero(step[i])} - kept:
        kept |= more
    return sorted(kept)
