"""One simulated trunk, step by step: what the simulator node drives."""

from __future__ import annotations

from collections import deque

from trunk_core.elementary import LARGEST_ANGLE
from trunk_core.errors import EXIT_FAILED, TrunkError
from trunk_core.samples import JointSample
from trunk_core.units import seconds

from .config import SimulatorConfig
from .disturbances import Disturbance
from .links import InFlight, Network, Traffic
from .noise import Noise
from .plant import TRUNK, PlantState
from .step import (
    Measurement,
    PlantStatus,
    act,
    at_rest,
    noisy,
    sense,
    torque_of,
)

MeasuredStep = tuple[Measurement, float]  # a reading, and the torque over the step before it, N m


class DivergedError(TrunkError, ArithmeticError):
    """The plant's state is no longer finite: the loop is unstable."""

    exit_code = EXIT_FAILED


def diverged(
    stamp_ns: int, status: PlantStatus, effort: float, config: SimulatorConfig
) -> DivergedError:
    """Return the error for a step of the plant, with this command [N m], that is not finite."""
    step = f"the step after t = {seconds(stamp_ns):g} s"
    plant = config.plant
    if config.kind.largest_angle(status.state, plant.constants) > 0.9 * LARGEST_ANGLE:
        turned = "the trunk, or the path's phase," if config.kind.name == TRUNK else "an angle"
        return DivergedError(
            f"{step} turns {turned} beyond {LARGEST_ANGLE:g} rad, "
            "the largest angle whose sine is computed"
        )
    torque = torque_of(status.effort, effort, plant)
    unit = config.kind.driven.effort_unit
    return DivergedError(
        f"the plant diverged in {step} (angle {status.state.theta:.3g} rad, "
        f"effort {torque:.3g} {unit}): the loop is unstable with these gains at this rate"
    )


class DelayLine:
    """The true state a whole number of steps ago; until there are that many, the oldest known one."""

    def __init__(self, steps: int) -> None:
        self._line: deque[PlantState] = deque(maxlen=steps + 1)

    def push(self, state: PlantState) -> PlantState:
        """Append the latest state and return the delayed one."""
        self._line.append(state)
        return self._line[0]

    def clear(self) -> None:
        """Forget the past."""
        self._line.clear()


class Simulation:
    """Keeps what `sense` and `act` need from one step to the next. Stamp k is k times the period.

    One step is ``truth`` and ``measure`` at stamp k, then ``step`` to stamp k + 1. ``measure`` remembers the
    state, for the sensors' delay: call it once per step.
    """

    def __init__(self, config: SimulatorConfig) -> None:
        """Begin at the initial state."""
        self.step_index = 0
        self._noise = Noise(config.seed)
        self._delay = DelayLine(config.delay_steps)
        self._wire = None if config.network is None else _Wire(config.network)
        self.reconfigure(config)
        self._begin()

    def reconfigure(self, config: SimulatorConfig) -> None:
        """Change plant, sensor or limit parameters; the state stays."""
        self.config = config
        self._plant = config.plant
        self._sensor = config.sensor
        self._noisy = noisy(config.sensor)
        self._period_ns = config.period_ns

    def _begin(self) -> None:
        self.status: PlantStatus = at_rest(self.config.initial_state, self._plant)
        self.falls_now = self.status.fallen  # the trunk fell in this state

    @property
    def state(self) -> PlantState:
        """The true state."""
        return self.status.state

    @property
    def stamp_ns(self) -> int:
        """Simulated time in ns."""
        return self.step_index * self._period_ns

    def truth(self) -> JointSample:
        """Return the true state; its effort is the torque applied over the previous step."""
        x, theta, x_dot, theta_dot = self.status.state
        return self._sample(x, theta, x_dot, theta_dot, self.status.effort)

    def measure(self, disturbance: Disturbance) -> JointSample:
        """Return the reading that reaches the controller, with its link's delays and losses.

        The sensors see the state with delay, bias, noise and the disturbance's offsets.
        """
        delayed = self._delay.push(self.status.state)
        noise = self._noise.pair(self.step_index) if self._noisy else (0.0, 0.0)
        measured = sense(delayed, disturbance, *noise, self._sensor)
        effort = self.status.effort
        if self._wire is not None:
            measured, effort = self._wire.read(self.step_index, (measured, effort))
        return self._sample(*measured, effort)

    def _sample(
        self, x: float, theta: float, x_dot: float, theta_dot: float, effort: float
    ) -> JointSample:
        return JointSample(
            self.stamp_ns,
            self.config.joints,
            (x, theta),
            (x_dot, theta_dot),
            (0.0, effort),
        )

    def step(self, effort: float, disturbance: Disturbance) -> None:
        """Advance one period, holding the commanded effort [N m], or the one that its link delivers, over it.

        Raises DivergedError where the new state is not finite; the state then stays as it was.
        """
        if self._wire is not None:
            effort = self._wire.command(self.step_index, effort)
        after = act(self.status, effort, disturbance, self._plant, *self.config.dynamics)
        if after.diverged:
            raise diverged(self.stamp_ns, self.status, effort, self.config)
        self.falls_now = after.fallen and not self.status.fallen
        self.status = after
        self.step_index += 1

    @property
    def ended_by_fall(self) -> bool:
        """True if the run is to end because the trunk has fallen."""
        return self.config.fall_stop and self.status.fallen

    def link_counts(self) -> dict[str, str]:
        """Return the fate of the messages of all states so far, in words; empty without links."""
        return {} if self._wire is None else self._wire.traffic.counts(self.step_index + 1)

    def reset(self) -> None:
        """Return the plant to its initial state. Time goes on: stamps never go backwards.

        Messages in flight on the links still arrive.
        """
        self._begin()
        self._delay.clear()


class _Wire:
    """Readings and commands in flight, step by step."""

    def __init__(self, network: Network) -> None:
        self.traffic = Traffic(network, stepwise=True)
        self._readings: InFlight[MeasuredStep] = InFlight(network.state, network.period_ns)
        self._commands: InFlight[float] = InFlight(network.command, network.period_ns)
        self._held: MeasuredStep

    def read(self, k: int, measured: MeasuredStep) -> MeasuredStep:
        """Send the reading of step k, and return the one in use at that step."""
        if not self.traffic.dropped(k):
            self._held = measured
        return self._readings.send(k, self._held, self.traffic.measurement_step(k))

    def command(self, k: int, effort: float) -> float:
        """Send the command of step k, N m, and return the one in use at that step, 0 for none."""
        used = self.traffic.command_step(k)
        acts = self._commands.send(k, effort, used if used >= 0 else k)
        return acts if used >= 0 else 0.0
