"""The loop of plant, sampled law and delays, linearised about the upright trunk, its hip on level ground.

Plant and law are linearised by central differences of the functions that run them (`act`, the law's
``update``). So whatever these do to small signals is in it: derivative mode and filter, gains of a rule
base at the origin, a drive's lag, viscous friction, delays of the sensors, a control rate below the plant's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from trunk_control.controller_config import ControllerConfig
from trunk_control.law import Constants, Hip, Law, LawMemory, Sample
from trunk_control.laws import law_of
from trunk_control.limits import Limits
from trunk_msgs_util.mechanics import Body
from trunk_msgs_util.recording.joint_table import Floats
from trunk_msgs_util.text import shortened
from trunk_msgs_util.units import seconds
from trunk_sim.actuator import Actuator
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState, accelerations
from trunk_sim.step import Plant, PlantStatus, act

from ..errors import PlanError

Complexes = npt.NDArray[np.complex128]
STEP = 1e-6  # of the differences, SI: their error is of the order of its square
STABLE = 1.0 - 1e-9  # spectral radius; closer to 1 than the differences are exact is not stable
_SETTLED = 4  # updates at rest after which a law's memory no longer changes its kind
_AT_REST = Disturbance()


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


def level(plant: Body, prescribed: bool = True) -> Body:
    """Return a body whose hip is on level ground: it moves uniformly, or is free to be pushed."""
    return plant._replace(prescribed=prescribed, as_printed=False, amplitude=0.0, harmonics=None)


def linearise(plant: Body) -> Linear:
    """Return the plant's linearisation at theta = 0 with a hip that moves uniformly on level ground.

    Raises PlanError for a plant whose accelerations are not finite.
    """
    p = level(plant)

    def response(theta: float, torque: float) -> float:
        return accelerations(PlantState(0.0, theta, 0.0, 0.0), 0.0, torque, p)[1]

    try:
        slope = (response(STEP, 0.0) - response(-STEP, 0.0)) / (2.0 * STEP)
        gain = response(0.0, 1.0)
    except ArithmeticError:
        slope = gain = nan
    if not (isfinite(slope) and isfinite(gain)):
        raise PlanError(
            f"the plant cannot be linearised: plant.length is {plant.length:g} m, "
            f"plant.trunk_mass {plant.trunk_mass:g} kg: too small for finite accelerations"
        )
    return Linear(slope, gain)


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
    """A plant and a controller, sampled with the period ``h`` [s], a torque u [N m] held between samples.

    ::

        x(k+1) = A x(k) + B u(k),     y(k) = C x(k-d) + D u(k-d)      plant, d periods of delay
        z(k+1) = F z(k) + G (y(k), r(k)),     u(k) = f (H z(k) + J (y(k), r(k)))     controller

    x: angle, rate and the drive's torque [3]; y: measured angle and rate [2]; z: what the law remembers
    and its command depends on [m]; r: the reference, rad; f: a factor on all gains.
    """

    a: Floats  # [3, 3]
    b: Floats  # [3]
    c: Floats  # [2, 3]
    d: Floats  # [2], 0 without delay
    memory: Floats  # F [m, m]
    input: Floats  # G [m, 3]
    output: Floats  # H [m]
    direct: Floats  # J [3]
    h: float
    delay: int = 0
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
            angles.append(float(state[0]))
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
            z, self.memory, self.input[:, :2], self.output[None, :], self.direct[None, :2]
        )
        values: Complexes = -self.factor * (law @ plant)[:, 0, 0] * z**-self.delay
        return values

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
    simulator: SimulatorConfig, config: ControllerConfig, prescribed: bool = True
) -> LinearLoop:
    """Return the loop of a plant, its hip prescribed or free (passive), and a controller.

    Raises PlanError where it cannot be linearised.
    """
    linearise(simulator.body)  # says so if it is the plant that cannot be
    plant = simulator.plant._replace(
        body=level(simulator.plant.body, prescribed),
        max_effort=inf,
        fall_angle=inf,
        actuator=linear_drive(simulator.actuator),
    )
    try:
        a, b = _plant_step(plant)
    except ArithmeticError:
        a, b = np.full((3, 3), inf), np.zeros(3)
    if not np.all(np.isfinite(a)):  # so long a period that the fall overflows
        a, b = np.full((3, 3), inf), np.zeros(3)
    dt = seconds(config.period_ns)
    (law,) = law_slopes(law_of(config), config.constants, config.limits, dt, [Hip()])
    m = len(law) - 1
    parts = law[:m, :m], law[:m, m:], law[m, :m], law[m, m:]
    every = max(1, round(config.period_ns / simulator.period_ns))
    # The sensors' delay in whole control periods, and what is left: so many plant periods before a sample.
    whole, early = divmod(simulator.delay_steps, every)
    c: Floats = np.eye(3)[:2]
    d: Floats = np.zeros(2)
    if early:
        before, held = _power(a, b, every - early)
        c, d, whole = c @ before, c @ held, whole + 1
    return LinearLoop(
        *_power(a, b, every),
        c,
        d,
        *_remembered(*parts),
        seconds(every * simulator.period_ns),
        whole,
    )


def _plant_step(plant: Plant) -> tuple[Floats, Floats]:
    """Return A [3, 3] and B [3] over one period of the plant, of angle, rate and the drive's torque."""

    def step(values: Floats) -> tuple[float, ...]:
        theta, rate, torque, effort = values.tolist()
        before = PlantStatus(PlantState(0.0, theta, 0.0, rate), torque, False, False)
        after = act(before, effort, _AT_REST, plant)
        if after.diverged:
            return nan, nan, nan
        return after.state.theta, after.state.theta_dot, after.effort

    slopes = _slopes(step, np.zeros(4))
    return slopes[:, :3], slopes[:, 3]


def law_slopes(
    law: Law, constants: Constants, limits: Limits, dt: float, hips: Sequence[Hip]
) -> Floats:
    """Return the Jacobians [hips, m + 1, m + 3] of a law's updates at rest, its limits out of the way.

    Of the m floats in its memory, and its command, by this memory, angle, rate and reference. The hip passes
    through ``hips``, period by period. Raises PlanError for a law that cannot be linearised.
    """
    limits = limits._replace(u_min=-inf, u_max=inf)

    def rest(hip: Hip) -> Sample:
        return Sample(0.0, 0.0, 0.0, dt, hip)

    memory = law.memory
    try:
        for k in range(-_SETTLED, 0):
            memory, _ = law.update(memory, rest(hips[k % len(hips)]), constants, limits)
        fields = memory._asdict()
        names = [name for name, value in fields.items() if isinstance(value, float)]
        for name in fields.keys() - names:
            if not isinstance(fields[name], bool):
                text = f"its memory's {name} is {shortened(repr(fields[name]))}, not a float"
                raise PlanError(f"{law.name} cannot be linearised: {text}")

        def step(values: Floats, memory: LawMemory, hip: Hip) -> tuple[float, ...]:
            *remembered, theta, rate, reference = values.tolist()
            before = memory._replace(**dict(zip(names, remembered, strict=True)))
            sample = Sample(reference, theta, rate, dt, hip)
            after, terms = law.update(before, sample, constants, limits)
            return (*(getattr(after, name) for name in names), nan if terms.held else terms.effort)

        slopes = []
        for hip in hips:
            at = np.array([*(getattr(memory, name) for name in names), 0.0, 0.0, 0.0])
            slopes.append(_slopes(partial(step, memory=memory, hip=hip), at))
            memory, _ = law.update(memory, rest(hip), constants, limits)
    except ArithmeticError:
        slopes = [np.array(nan)]
    if not np.all(np.isfinite(slopes)):
        raise PlanError(
            f"{law.name} cannot be linearised about the upright: its command is not finite there"
        )
    return np.array(slopes)


def _slopes(function: Callable[[Floats], tuple[float, ...]], at: Floats) -> Floats:
    """Return the Jacobian of a function [outputs, inputs] by central differences."""
    columns = []
    for direction in np.eye(len(at)) * STEP:
        above, below = function(at + direction), function(at - direction)
        columns.append((np.array(above) - np.array(below)) / (2.0 * STEP))
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
