"""One simulated trunk, step by step: what the simulator node and the offline run both drive."""

from __future__ import annotations

from contextlib import suppress
from math import isfinite

from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import seconds

from .config import SimulatorConfig
from .disturbances import Disturbance
from .integrator import advance
from .plant import PlantState
from .sensors import DelayLine, NoiseStream, measure


class DivergedError(ArithmeticError):
    """The plant's state left the finite numbers: the loop is unstable."""


def saturate(effort: float, limit: float) -> float:
    """Return the effort in N m, clamped to +- limit."""
    return limit if effort > limit else -limit if effort < -limit else effort


class Simulation:
    """The plant, its sensors and its clock. Time is the step counter: stamp k is k times the period.

    One step is ``truth`` and ``measure`` at stamp k, then ``step`` to stamp k + 1. ``measure`` draws the
    step's noise and is called once per step.
    """

    def __init__(self, config: SimulatorConfig) -> None:
        self.step_index = 0
        self.applied_effort = 0.0  # N m, over the step before
        self.state: PlantState = config.initial_state
        self.fell_ns: int | None = None  # stamp of the first state beyond the fall's angle
        self._noise = NoiseStream(config.seed)
        self._delay = DelayLine(config.delay_steps)
        self.retune(config)
        self._note_fall()

    def retune(self, config: SimulatorConfig) -> None:
        """Take new plant, sensor or limit parameters; the state stays."""
        self.config = config
        self._plant = config.plant
        self._sensor = config.sensor
        self._period_ns = config.period_ns
        self._period = seconds(config.period_ns)

    @property
    def stamp_ns(self) -> int:
        """Simulated time in ns."""
        return self.step_index * self._period_ns

    def truth(self) -> JointSample:
        """Return the true state; its effort is the torque applied over the step before."""
        state = self.state
        return JointSample(
            self.stamp_ns,
            self.config.joints,
            (state.x, state.theta),
            (state.x_dot, state.theta_dot),
            (0.0, self.applied_effort),
        )

    def measure(self, disturbance: Disturbance) -> JointSample:
        """Return what the sensors say now: delay, bias, noise and the disturbance's offsets on."""
        position_sample, velocity_sample = self._noise.next_pair()
        seen = measure(
            self._delay.push(self.state),
            disturbance,
            position_sample,
            velocity_sample,
            self._sensor,
        )
        return JointSample(
            self.stamp_ns,
            self.config.joints,
            (seen.x, seen.theta),
            (seen.x_dot, seen.theta_dot),
            (0.0, self.applied_effort),
        )

    def step(self, effort: float, disturbance: Disturbance) -> None:
        """Advance one period with the commanded effort [N m] held over it.

        Raises DivergedError where the new state is not finite; the state then stays as it was.
        """
        torque = saturate(effort, self.config.max_effort)
        state: PlantState | None = None
        with suppress(ValueError, ArithmeticError):  # sin(inf), or a divisor too small for a float
            state = advance(
                self.state,
                disturbance.hip_force,
                torque + disturbance.trunk_torque,
                self._period,
                self.config.substeps,
                self._plant,
            )
        if state is None or not all(map(isfinite, state)):
            raise DivergedError(
                f"the plant diverged in the step after t = {seconds(self.stamp_ns):g} s "
                f"(angle {self.state.theta:.3g} rad, effort {torque:.3g} N m): the loop is unstable "
                "with these gains at this rate"
            )
        self.state = state
        self.applied_effort = torque
        self.step_index += 1
        self._note_fall()

    def _note_fall(self) -> None:
        if self.fell_ns is None and abs(self.state.theta) > self.config.fall_angle:
            self.fell_ns = self.stamp_ns

    @property
    def falls_now(self) -> bool:
        """True at the state with which the trunk has fallen."""
        return self.fell_ns == self.stamp_ns

    @property
    def ended_by_fall(self) -> bool:
        """True where the run is to be finished because the trunk has fallen."""
        return self.config.fall_stop and self.fell_ns is not None

    def reset(self) -> None:
        """Put the plant back to its initial state. Time goes on: stamps never run back."""
        self.state = self.config.initial_state
        self.applied_effort = 0.0
        self.fell_ns = None
        self._delay.clear()
        self._note_fall()
