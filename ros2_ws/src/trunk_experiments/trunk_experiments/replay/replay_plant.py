"""A recorded run's plant recomputed: each state and its measurement from the torque before it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import nanoseconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.noise import Noise, noise_samples
from trunk_sim.operator_input import with_operator
from trunk_sim.plant import PlantState
from trunk_sim.quick import act_for
from trunk_sim.simulation import Seen, Simulation
from trunk_sim.step import (
    Measurement,
    SensorParameters,
    Trunk,
    act,
    at_rest,
    moved,
    noisy,
    pruned,
    sense,
)

from ..plans.timeline import Change
from ..recorded.run import RecordedRun
from ..recorded.turns import exact_from_ns
from ..recorded.wire import RecordedWire
from . import replay, stretches
from .bits import same
from .plant_columns import QUANTITIES, by_row, filled, held, is_whole, latest_in_force
from .real_time import PossibleDisturbances
from .replay import Checked, Difference, acting_at, compare, disturbances_matrix, judged


class _Epoch(NamedTuple):
    """From a row on, how the sensors read: what they remember reaches back to a row."""

    row: int
    remembered: int
    sensor: SensorParameters


class PlantReplay:
    """The plant of a run, one step after the other.

    Where time is exact, the torque over a step is the command for its first state, and the disturbance the
    one with its stamp. In real time the torque is the one that the next true state records
    (`real_time.replay_torques` judges whether it could be), and the disturbance any that may have acted
    and fits. After a difference it continues from the recorded value, so that one altered value counts once.
    """

    def __init__(self, run: RecordedRun, until_ns: int | None = None) -> None:
        self._truth = run.table(topics.GROUND_TRUTH)
        self._measured = run.table(topics.JOINT_STATES)
        self._commands = run.table(topics.EFFORT_COMMAND)
        self._disturbances = run.table(topics.DISTURBANCE)
        self._stamps = judged(self._truth.stamp_ns, until_ns)
        self._fell = {event.stamp_ns for event in run.events if event.message == Event.FELL}
        self._marked = "fall.angle" in run.parameters["simulator"]
        self._timeline = run.timeline("simulator")
        config: SimulatorConfig = self._timeline.config
        self._delay_steps = config.delay_steps
        self._noise = Noise(config.seed)
        self._wire = RecordedWire(config, self._stamps)
        self._oldest = self._wire.oldest
        # Of an earlier row, in real time: what may have acted, where that is not the message of its stamp.
        self._acted: dict[int, list[Disturbance]] = {}
        self._epochs: list[_Epoch] = []
        self._remembered = 0
        self._windowed = -1, False
        self._held_window: tuple[int, stretches.PlantRecord]
        self._possible = (
            None if run.exact else PossibleDisturbances(self._disturbances, exact_from_ns(run))
        )
        self._acting: list[tuple[int, Disturbance]] = []
        self._operated = run.operated
        self._held = held(run, self._commands)
        self._steps = self._stamps // config.period_ns
        self._row = -1  # before the first state
        self._regular = False
        self.retune(config)
        self.reset()
        self._timeline.advance(0, self)  # changes before the first state act on it
        self._row = 0

    def retune(self, config: SimulatorConfig) -> None:
        """Change the parameters of plant and sensors."""
        self._plant, self._sensor, self._initial = config.plant, config.sensor, config.initial_state
        self._epochs.append(_Epoch(self._row + 1, self._remembered, self._sensor))

    def reset(self) -> None:
        """Return the plant to its initial state and clear the sensors' past."""
        self._trunk = at_rest(self._initial, self._plant)
        self._falls = self._trunk.fallen
        self._remembered = self._row + 1
        self._epochs.append(_Epoch(self._remembered, self._remembered, self._sensor))

    def __iter__(self) -> Iterator[Checked]:
        """Yield what differs in each recorded true state and in its measurement."""
        self._regular = regular = self._is_regular()
        while self._row < len(self._stamps):
            stamp_ns = int(self._stamps[self._row])
            if regular and (passed := self._pass_over()):
                last_ns = int(self._stamps[self._row - 1])
                if self._possible is not None:
                    self._possible.passed(stamp_ns, last_ns)
                yield Checked(stamp_ns, (), passed, last_ns=last_ns)
                continue
            yield Checked(stamp_ns, self._looked_at(stamp_ns))
            if self._row + 1 == len(self._stamps) or not self._step(stamp_ns):
                return
            self._row += 1

    def resumed(self) -> Simulation:
        """Return the simulation before the last state that was judged; call it after all have been."""
        past = range(max(self._row - self._delay_steps, self._remembered), self._row)
        return Simulation.resumed(
            self._timeline.config,
            int(self._steps[self._row]),
            self._trunk,
            self._falls,
            [self._recorded(row) for row in past],
            act_for(self._timeline.config, self._regular),
            self._sent(),
        )

    def _sent(self) -> Iterator[tuple[Seen, float]]:
        """Yield the reading and the command of each state before the current one, if there are links."""
        told = sorted(self._commands.rows)
        for row in range(self._row if self._wire.linked else 0):
            stamp_ns = int(self._stamps[row])
            effort = self._command(stamp_ns)
            if effort is None:  # in real time, an earlier one acted
                effort = latest_in_force(self._commands, told, stamp_ns, self._timeline.config)
            yield (self._reading(row, self._acted_at(row)[0]), self._effort(row)), effort

    @property
    def to_come(self) -> list[Change]:
        """The simulator's changes that take effect after the last state that was judged."""
        return self._timeline.to_come

    def _pass_over(self) -> int:
        """Skip states that are as recorded; return how many."""
        before = self._row
        begin, record = self._window(before)
        # A change stamped k came while state k was the latest: it acts on the step to k + 1.
        last = int(np.searchsorted(self._stamps, self._timeline.next_ns))
        last = min(last, begin + len(record.truth), len(self._stamps) - 1)
        row, self._trunk, self._falls = stretches.compiled_plant()(
            before - begin,
            max(last, before) - begin,
            self._trunk,
            self._falls,
            self._remembered - begin,
            self._epochs[-1].row - begin,
            self._delay_steps,
            pruned(self._plant),
            self._sensor,
            record,
            self._possible is not None,
        )
        self._row = begin + row
        return self._row - before

    def _window(self, row: int) -> tuple[int, stretches.PlantRecord]:
        """Return the record around a row for compiled code, and its first row."""
        number = row // stretches.LONGEST, noisy(self._sensor)
        if self._windowed != number:
            first = number[0] * stretches.LONGEST
            # What is still to be seen of the past.
            begin = max(first - self._delay_steps - self._oldest, 0)
            record = self._record(begin, min(first + stretches.LONGEST, len(self._stamps)))
            self._windowed, self._held_window = number, (begin, record)
        return self._held_window

    def _looked_at(self, stamp_ns: int) -> list[Difference]:
        """Return what differs at the current state; if anything does, continue from the record."""
        trunk, found = self._trunk, list[Difference]()
        x, theta, x_dot, theta_dot = trunk.state
        for quantity, values in zip(
            QUANTITIES, ((x, theta), (x_dot, theta_dot), (0.0, trunk.effort)), strict=True
        ):
            found += compare(self._truth, stamp_ns, quantity, values)
        if self._marked and self._falls != (stamp_ns in self._fell):
            mark = float(stamp_ns in self._fell)
            found.append(Difference(stamp_ns, topics.RUN_EVENTS, Event.FELL, mark, 1.0 - mark))
        if found:
            effort = self._truth.get(stamp_ns, "effort")[1]
            self._trunk = Trunk(self._recorded(self._row), effort, trunk.fallen, False)
        self._acting = self._candidates(stamp_ns)
        if stamp_ns in self._measured:
            found += self._looked_at_measured(stamp_ns)
        return found

    def _looked_at_measured(self, stamp_ns: int) -> list[Difference]:
        """Return what differs in the measured state; where it tells which disturbance acted, note it."""
        row = self._row_of(self._wire.seen_ns(stamp_ns))
        if row is None:
            return []  # it is not on record
        options = [one for _, one in self._acting] if row == self._row else self._acted_at(row)
        fitting = [i for i, one in enumerate(options) if not any(self._sensed(stamp_ns, row, one))]
        if row == self._row:
            self._acting = [self._acting[i] for i in fitting] or self._acting[:1]
        return [] if fitting else list(self._sensed(stamp_ns, row, options[0]))

    def _row_of(self, stamp_ns: int) -> int | None:
        """Return the row of a recorded true state."""
        row = int(np.searchsorted(self._stamps, stamp_ns))
        return row if row < len(self._stamps) and self._stamps[row] == stamp_ns else None

    def _acted_at(self, row: int) -> list[Disturbance]:
        """Return what may have acted in the state of an earlier row."""
        return self._acted.get(row) or [acting_at(self._disturbances, int(self._stamps[row]))]

    def _candidates(self, stamp_ns: int) -> list[tuple[int, Disturbance]]:
        """Return what may act in this state and on the step from it, with its message's stamp."""
        if self._possible is None:
            return [(stamp_ns, acting_at(self._disturbances, stamp_ns))]
        timeout_ns = nanoseconds(self._timeline.config.command_timeout)
        return list(self._possible.at(stamp_ns, timeout_ns))

    def _sensed(self, stamp_ns: int, row: int, acting: Disturbance) -> Iterator[Difference]:
        """Yield what differs in a measured state from what the sensors said in a row."""
        seen = self._reading(row, acting)
        yield from compare(self._measured, stamp_ns, "position", (seen.x, seen.theta))
        yield from compare(self._measured, stamp_ns, "velocity", (seen.x_dot, seen.theta_dot))
        effort = self._trunk.effort if row == self._row else self._effort(row)
        yield from compare(self._measured, stamp_ns, "effort", (0.0, effort))

    def _reading(self, row: int, acting: Disturbance) -> Measurement:
        """Return what the sensors say in a row."""
        _, remembered, sensor = next(one for one in reversed(self._epochs) if one.row <= row)
        delayed = self._recorded(min(max(row - self._delay_steps, remembered), row))
        step = max(int(self._steps[row]), 0)
        noise = self._noise.pair(step) if noisy(sensor) else (0.0, 0.0)
        return sense(delayed, acting, *noise, sensor)

    def _effort(self, row: int) -> float:
        """Return the recorded torque over the step before a row's state, N m."""
        return float(self._truth.values("effort")[row, 1])

    def _recorded(self, row: int) -> PlantState:
        position, velocity = (self._truth.values(q)[row].tolist() for q in ("position", "velocity"))
        return PlantState(position[0], position[1], velocity[0], velocity[1])

    def _step(self, stamp_ns: int) -> bool:
        """Step to the next state; return False if the plant diverges and there is none."""
        command = self._torque(stamp_ns)
        if command is None:
            return True
        self._timeline.advance(stamp_ns + 1, self)
        # In real time it is the recorded torque, whatever the actuator made it of.
        make = act if self._possible is None else moved
        applied = self._operated.at(stamp_ns)
        steps = [
            (one, make(self._trunk, command, with_operator(one[1], applied), self._plant))
            for one in self._acting
        ]
        fitting = [one for one in steps if self._fits(one[1])]
        if self._possible is not None and fitting:
            self._possible.chosen(min(since_ns for (since_ns, _), _ in fitting))
            if self._wire.linked:
                self._acted[self._row] = [one for (_, one), _ in fitting]
        _, after = (fitting or steps)[0]
        self._falls = after.fallen and not self._trunk.fallen
        self._trunk = after
        return not after.diverged

    def _fits(self, after: Trunk) -> bool:
        """Return True if a next state is the recorded one."""
        row = self._row + 1
        return row < len(self._stamps) and all(map(same, after.state, self._recorded(row)))

    def _torque(self, stamp_ns: int) -> float | None:
        """Return the torque over the step from this state, N m; None if the record does not tell it."""
        if self._possible is None:
            told_ns = self._wire.told_ns(stamp_ns)
            return self._command(told_ns) if told_ns >= 0 else 0.0
        row = self._row + 1
        return float(self._truth.values("effort")[row, 1]) if row < len(self._stamps) else None

    def _command(self, stamp_ns: int) -> float | None:
        """Return the command for a state, N m, or what acts where nobody is to answer it."""
        told = stamp_ns in self._commands
        return self._commands.get(stamp_ns, "effort")[0] if told else self._held.get(stamp_ns)

    def _is_regular(self) -> bool:
        """Return True if compiled code is worthwhile, and the record is as it takes it."""
        stamps, disturbances = self._stamps, self._disturbances
        cost = max(self._plant.substeps // 2, 1)  # two Runge-Kutta steps take as long as a law
        return (
            all(is_whole(table) for table in (self._truth, self._measured))
            and self._marked
            and replay.worth_compiling(stamps, cost)
            and np.array_equal(self._steps, np.arange(len(stamps)))
            and self._commands.widths["effort"] == 1
            and (
                not len(disturbances)
                or all(disturbances.widths[q] == 2 for q in ("position", "effort"))
            )
        )

    def _record(self, first: int, stop: int) -> stretches.PlantRecord:
        """Return the record of the states in [first, stop)."""
        stamps = self._stamps[first:stop]
        disturbances = np.zeros((len(stamps), 4))
        if len(self._disturbances):
            rows = self._disturbances.rows_of(stamps)
            known = rows >= 0
            disturbances[known] = disturbances_matrix(self._disturbances, rows[known])
        if self._operated:
            applied = self._operated.over(stamps)
            acts = applied.any(axis=1)  # as `with_operator` adds it
            disturbances[acts, :2] += applied[acts]
        return stretches.PlantRecord(
            by_row(self._truth, stamps),
            by_row(self._measured, stamps),
            self._torques(first, stop),
            disturbances,
            np.isin(stamps, list(self._fell)).astype(np.int64),
            noise_samples(self._noise.seed, len(stamps), first)
            if noisy(self._sensor)
            else np.zeros((len(stamps), 2)),
            self._wire.seen(first, stop) - first,
        )

    def _torques(self, first: int, stop: int) -> Floats:
        """Return the torque over the step from each of these states [N], NaN where it is not recorded."""
        stamps = self._stamps[first:stop]
        if self._possible is None:
            told = self._wire.all_told_ns(stamps)
            efforts, rows = self._commands.values("effort"), self._commands.rows_of(told)
            torques = np.ascontiguousarray(filled(efforts, rows)[:, 0])
            for stamp_ns, effort in self._held.items():
                torques[told == stamp_ns] = effort
            torques[told < 0] = 0.0
            return torques
        acted = by_row(self._truth, self._stamps[first + 1 : stop + 1])[:, -1]
        return np.append(acted, np.nan)[: len(stamps)]
