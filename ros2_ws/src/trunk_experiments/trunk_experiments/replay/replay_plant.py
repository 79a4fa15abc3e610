"""A recorded run's plant recomputed: each state and its measurement from the torque before it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.units import nanoseconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.disturbances import Disturbance
from trunk_sim.operator_input import with_operator
from trunk_sim.quick import act_for
from trunk_sim.simulation import Seen, Simulation
from trunk_sim.step import Trunk, act, at_rest, moved, noisy, pruned

from ..plans.timeline import Change
from ..recorded.run import RecordedRun
from ..recorded.turns import exact_from_ns
from ..recorded.wire import RecordedWire
from . import stretches
from .bits import same
from .plant_columns import QUANTITIES, latest_in_force
from .plant_states import RecordedStates
from .plant_torques import RecordedTorques
from .plant_windows import PlantWindows
from .real_time import PossibleDisturbances
from .replay import Checked, Difference, acting_at, compare, judged


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
        self._wire = RecordedWire(config, self._stamps)
        self._states = RecordedStates(self._truth, self._stamps, config)
        self._torques = RecordedTorques(run, self._states, self._wire)
        self._windows = PlantWindows(run, self._states, self._torques, self._wire, self._fell)
        # Of an earlier row, in real time: what may have acted, where that is not the message of its stamp.
        self._acted: dict[int, list[Disturbance]] = {}
        self._possible = (
            None if run.exact else PossibleDisturbances(self._disturbances, exact_from_ns(run))
        )
        self._acting: list[tuple[int, Disturbance]] = []
        self._operated = run.operated
        self._row = -1  # before the first state
        self._regular: bool  # what compiled code takes; set where the states are gone through
        self.retune(config)
        self.reset()
        self._timeline.advance(0, self)  # changes before the first state act on it
        self._row = 0

    def retune(self, config: SimulatorConfig) -> None:
        """Change the parameters of plant and sensors."""
        self._plant, self._sensor, self._initial = config.plant, config.sensor, config.initial_state
        self._states.sensors_from(self._row + 1, self._sensor)

    def reset(self) -> None:
        """Return the plant to its initial state and clear the sensors' past."""
        self._trunk = at_rest(self._initial, self._plant)
        self._falls = self._trunk.fallen
        self._states.forget_before(self._row + 1, self._sensor)

    def __iter__(self) -> Iterator[Checked]:
        """Yield what differs in each recorded true state and in its measurement."""
        self._regular = regular = self._windows.are_worthwhile(self._plant)
        while self._row < len(self._stamps):
            stamp_ns = int(self._stamps[self._row])
            if regular and (passed := self._pass_over()):
                last_ns = int(self._stamps[self._row - 1])
                if self._possible is not None:
                    self._possible.passed(
                        stamp_ns, last_ns, self._timeout_ns, self._channels_without_effect()
                    )
                yield Checked(stamp_ns, (), passed, last_ns=last_ns)
                continue
            yield Checked(stamp_ns, self._looked_at(stamp_ns))
            if self._row + 1 == len(self._stamps) or not self._step(stamp_ns):
                return
            self._row += 1

    def resumed(self) -> Simulation:
        """Return the simulation before the last state that was judged; call it after all have been."""
        return Simulation.resumed(
            self._timeline.config,
            int(self._states.steps[self._row]),
            self._trunk,
            self._falls,
            self._states.to_be_seen(self._row),
            act_for(self._timeline.config, self._regular),
            self._sent(),
        )

    def _sent(self) -> Iterator[tuple[Seen, float]]:
        """Yield the reading and the command of each state before the current one, if there are links."""
        if not self._wire.linked:
            return
        told = sorted(self._commands.rows)
        for row in range(self._row):
            stamp_ns = int(self._stamps[row])
            effort = self._torques.command(stamp_ns)
            if effort is None:  # in real time, an earlier one acted
                effort = latest_in_force(self._commands, told, stamp_ns, self._timeline.config)
            seen = self._states.reading(row, self._acted_at(row)[0]), self._states.effort(row)
            yield seen, effort

    @property
    def to_come(self) -> list[Change]:
        """The simulator's changes that take effect after the last state that was judged."""
        return self._timeline.to_come

    def _pass_over(self) -> int:
        """Skip states that are as recorded; return how many."""
        before = self._row
        begin, record = self._windows.around(before, noisy(self._sensor))
        # A change stamped k came while state k was the latest: it acts on the step to k + 1.
        last = int(np.searchsorted(self._stamps, self._timeline.next_ns))
        last = min(last, begin + len(record.truth) - 1)
        row, self._trunk, self._falls = stretches.compiled_plant()(
            before - begin,
            max(last, before) - begin,
            self._trunk,
            self._falls,
            self._states.remembered - begin,
            self._states.changed - begin,
            self._states.delay_steps,
            pruned(self._plant),
            self._sensor,
            record,
            self._possible is not None,
        )
        self._row = begin + row
        return self._row - before

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
            self._trunk = Trunk(self._states.state(self._row), effort, trunk.fallen, False)
        self._acting = self._candidates(stamp_ns)
        if stamp_ns in self._measured:
            found += self._looked_at_measured(stamp_ns)
        return found

    def _looked_at_measured(self, stamp_ns: int) -> list[Difference]:
        """Return what differs in the measured state; where it tells which disturbance acted, note it."""
        row = self._states.row_of(self._wire.seen_ns(stamp_ns))
        if row is None:
            return []  # it is not on record
        options = [one for _, one in self._acting] if row == self._row else self._acted_at(row)
        fitting = [i for i, one in enumerate(options) if not any(self._sensed(stamp_ns, row, one))]
        if row == self._row:
            self._acting = [self._acting[i] for i in fitting] or self._acting[:1]
        return [] if fitting else list(self._sensed(stamp_ns, row, options[0]))

    def _acted_at(self, row: int) -> list[Disturbance]:
        """Return what may have acted in the state of an earlier row."""
        return self._acted.get(row) or [acting_at(self._disturbances, int(self._stamps[row]))]

    def _candidates(self, stamp_ns: int) -> list[tuple[int, Disturbance]]:
        """Return what may act in this state and on the step from it, with its message's stamp."""
        if self._possible is None:
            return [(stamp_ns, acting_at(self._disturbances, stamp_ns))]
        return list(self._possible.at(stamp_ns, self._timeout_ns))

    @property
    def _timeout_ns(self) -> int:
        return nanoseconds(self._timeline.config.command_timeout)

    def _channels_without_effect(self) -> list[int]:
        """Return the numbers of the disturbance's channels that may change nothing on record."""
        found = []
        if self._plant.body.prescribed:
            found.append(Disturbance._fields.index("hip_force"))
        if self._sensor.scale is not None:  # rounded to the resolution, or at its limits
            found.append(Disturbance._fields.index("trunk_offset"))
        return found

    def _sensed(self, stamp_ns: int, row: int, acting: Disturbance) -> Iterator[Difference]:
        """Yield what differs in a measured state from what the sensors said in a row."""
        seen = self._states.reading(row, acting)
        yield from compare(self._measured, stamp_ns, "position", (seen.x, seen.theta))
        yield from compare(self._measured, stamp_ns, "velocity", (seen.x_dot, seen.theta_dot))
        effort = self._trunk.effort if row == self._row else self._states.effort(row)
        yield from compare(self._measured, stamp_ns, "effort", (0.0, effort))

    def _step(self, stamp_ns: int) -> bool:
        """Step to the next recorded state; return False if the plant diverges."""
        command = self._torques.over(self._row)
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
        return all(map(same, after.state, self._states.state(self._row + 1)))
