"""A run's recorded states of the plant, by row, and what its sensors said in each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Integers
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.noise import Noise
from trunk_sim.plant import PlantState
from trunk_sim.step import Measurement, SensorParameters, noisy, sense

from ..recorded.joint_table import JointTable


class _Epoch(NamedTuple):
    """How the sensors read from a row on, and the oldest row that they remember."""

    row: int
    remembered: int
    sensor: SensorParameters


class RecordedStates:
    """The true states in file order, and sensors that change from row to row."""

    def __init__(self, truth: JointTable, stamps: Integers, config: SimulatorConfig) -> None:
        """``stamps``: of the states that are judged, the first ones of the table, ns."""
        self.stamps = stamps
        self.steps: Integers = stamps // config.period_ns
        self.delay_steps = config.delay_steps
        self.remembered = 0  # the oldest row that the sensors' delay may reach back to
        self._truth = truth
        self._noise = Noise(config.seed)
        self._epochs: list[_Epoch] = []

    def __len__(self) -> int:
        return len(self.stamps)

    def row_of(self, stamp_ns: int) -> int | None:
        """Return the row of a recorded true state."""
        row = int(np.searchsorted(self.stamps, stamp_ns))
        return row if row < len(self.stamps) and self.stamps[row] == stamp_ns else None

    def state(self, row: int) -> PlantState:
        position, velocity = (self._truth.values(q)[row].tolist() for q in ("position", "velocity"))
        return PlantState(position[0], position[1], velocity[0], velocity[1])

    def effort(self, row: int) -> float:
        """Return the recorded torque over the step before a row's state, N m."""
        return float(self._truth.values("effort")[row, 1])

    def sensors_from(self, row: int, sensor: SensorParameters) -> None:
        """Let the sensors read in this way from a row on."""
        self._epochs.append(_Epoch(row, self.remembered, sensor))

    def forget_before(self, row: int, sensor: SensorParameters) -> None:
        """Let the sensors remember nothing of the rows before this one."""
        self.remembered = row
        self.sensors_from(row, sensor)

    @property
    def changed(self) -> int:
        """The first row in which the sensors were as they are now."""
        return self._epochs[-1].row

    def reading(self, row: int, acting: Disturbance) -> Measurement:
        """Return what the sensors say in a row while this disturbance acts."""
        _, remembered, sensor = next(one for one in reversed(self._epochs) if one.row <= row)
        delayed = self.state(min(max(row - self.delay_steps, remembered), row))
        step = max(int(self.steps[row]), 0)
        noise = self._noise.pair(step) if noisy(sensor) else (0.0, 0.0)
        return sense(delayed, acting, *noise, sensor)

    def to_be_seen(self, row: int) -> list[PlantState]:
        """Return the states before a row that the sensors still have to see, the oldest first."""
        return [self.state(k) for k in range(max(row - self.delay_steps, self.remembered), row)]
