"""Records an offline run with the topics, schemas and parameters that the graph records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Floats, Integers
from trunk_core.files import atomic_write
from trunk_core.parameters.declarations import Value, declarations, values_of
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.samples import JointSample
from trunk_core.topics import INPUT_NAMES, Event
from trunk_core.units import nanoseconds
from trunk_msgs_util.picture.film import Film
from trunk_msgs_util.source import NO_SOURCE
from trunk_recording import provenance
from trunk_recording.cdr import JointStateLayout, layout_of, shared
from trunk_recording.schemas import event, parameter_event
from trunk_recording.writer import PROVENANCE, RecordingWriter, Rows
from trunk_sim.disturbances import Disturbance, disturbance_sample
from trunk_sim.links import Traffic
from trunk_sim.simulation import DivergedError

from .engine import (
    ACTING,
    APPLIED,
    EFFORT,
    FRESH,
    OFFSET,
    POSITION,
    REFERENCE,
    SEEN_APPLIED,
    SEEN_POSITION,
    SEEN_VELOCITY,
    TERMS,
    VELOCITY,
    States,
    states_of_run,
)
from .loop import disturbance_source, states_of
from .nodes import config_class
from .plan import RunPlan
from .timeline import Change, GivenInputs

# The places of messages among those of a state, in the graph's order.
TURNED, _TRUTH, _FIRST_DISTURBANCE, _DISTURBANCE, _MEASURED = range(5)
_COMMAND, _TERMS, FELL, _INPUTS, PICTURE = range(5, 10)
PLACES = 10


class StateMessages:
    """Packs the joint states, commands, terms and disturbances of a plan's run."""

    def __init__(
        self, plan: RunPlan, channels: Mapping[str, int], acting: Callable[[int], Disturbance]
    ) -> None:
        """``acting`` gives the disturbance at increasing stamps, ns."""
        self._plan, self._channels, self._acting = plan, channels, acting
        given = plan.inputs
        # All commands, where earlier ones may act.
        self._efforts: Floats = np.zeros(0 if given is None else states_of(plan))
        self._references_ns = np.array(list(given.references if given else ()), np.int64)
        self._last = -1  # the last state that was answered
        self._of_simulator = plan.timeline("simulator")

    def stamps(self, first: int, count: int) -> Integers:
        return np.arange(first, first + count) * self._plan.simulator.period_ns

    def of(self, states: States, stamp_ns: Integers) -> list[Rows]:
        """Return the messages that come with each state."""
        table, joints = states.table, self._plan.simulator.joints
        every = np.arange(len(table))
        layout = JointStateLayout(joints, 2, 2, 2)
        effort, measured_torque = np.zeros((2, len(table), 2))
        effort[:, 1], measured_torque[:, 1] = table[:, APPLIED], table[:, SEEN_APPLIED]
        rows_of_all = [
            self._joints(
                topics.GROUND_TRUTH,
                every * PLACES + _TRUTH,
                layout,
                stamp_ns,
                position=table[:, POSITION],
                velocity=table[:, VELOCITY],
                effort=effort,
            ),
            self._joints(
                topics.JOINT_STATES,
                every * PLACES + _MEASURED,
                layout,
                stamp_ns,
                position=table[:, SEEN_POSITION],
                velocity=table[:, SEEN_VELOCITY],
                effort=measured_torque,
            ),
        ]
        if self._plan.disturbance is not None:
            rows_of_all.append(self._disturbances(states))
        for name, rows in states.answers():
            names = states.term_names.get(name, ())
            rows_of_all += self._answers(name, names, table[rows], stamp_ns[rows], every[rows])
        if self._plan.inputs is not None:
            rows_of_all += self._inputs(states, stamp_ns, self._plan.inputs)
        return rows_of_all

    def _inputs(self, states: States, stamp_ns: Integers, given: GivenInputs) -> Iterator[Rows]:
        """Yield the inputs that act in each state, as the simulator records them in real time.

        A state that is not given is answered at once.
        """
        table, count, plan = states.table, len(stamp_ns), self._plan
        values: Floats = np.zeros((count, 5))
        period_ns, here = plan.simulator.period_ns, np.arange(count) + states.first
        self._efforts[here] = table[:, EFFORT]
        answered = np.full(count, -1)
        for _, span in states.answers():
            answered[span] = here[span]
        last = np.maximum.accumulate(np.append(self._last, answered))[1:]
        self._last = int(last[-1])
        if states.first < len(given):
            at, since = given.command_ns[here], given.disturbance_ns[here]
            if given.command is None:
                values[:, 0] = self._efforts[at // period_ns]
            else:
                values[:, 0] = given.command[here]
                yield from self._of_others(given, here)
        else:
            at = np.where(last >= 0, last * period_ns, -1)
            # A change acts on the step from the state after it.
            self._of_simulator.advance(int(stamp_ns[0]) - period_ns + 1)
            timeout_ns = nanoseconds(self._of_simulator.config.command_timeout)
            at[stamp_ns - at > timeout_ns] = -1
            values[:, 0] = self._efforts[last]
            since = stamp_ns if plan.disturbance is not None else np.full(count, -1)
        values[at < 0, 0] = 0.0
        values[:, 1:3], values[:, 3:] = table[:, ACTING], table[:, OFFSET]
        age = np.column_stack([np.where(ns >= 0, stamp_ns - ns, -1) for ns in (at, *[since] * 4)])
        yield self._joints(
            topics.PLANT_INPUTS,
            np.arange(count) * PLACES + _INPUTS,
            JointStateLayout(INPUT_NAMES, 5, 5, 0, " ".join([NO_SOURCE] * 3)),
            stamp_ns,
            position=values,
            velocity=age.astype(np.float64),
        )

    def _of_others(self, given: GivenInputs, here: Integers) -> Iterator[Rows]:
        """Yield an external node's commands, each with the first state in which it acts, and references."""
        assert given.command is not None  # for the type
        joint = (self._plan.simulator.joints[1],)
        at = given.command_ns[here]
        new = np.flatnonzero((at >= 0) & (at != np.append(-1, given.command_ns)[here]))
        yield self._joints(
            topics.EFFORT_COMMAND,
            new * PLACES + _COMMAND,
            JointStateLayout(joint, 0, 0, 1),
            at[new],
            effort=given.command[here[new], None],
        )
        if topics.REFERENCE in self._channels:
            stamp_ns = here * self._plan.simulator.period_ns
            known = np.flatnonzero(np.isin(stamp_ns, self._references_ns))
            values = [given.references[ns] for ns in stamp_ns[known].tolist()]
            yield self._joints(
                topics.REFERENCE,
                known * PLACES + _COMMAND,
                JointStateLayout(joint, 1),
                stamp_ns[known],
                position=np.array(values).reshape(-1, 1),
            )

    def _disturbances(self, states: States) -> Rows:
        """Return the disturbances: like the node, one step ahead of the state, and both for the first."""
        count = len(states.table)
        stamp_ns = self.stamps(states.first, count + 1)
        place = np.arange(-1, count) * PLACES + _DISTURBANCE
        place[0] = _FIRST_DISTURBANCE
        wanted = stamp_ns >= self._plan.disturbed_ns
        wanted[0] &= states.first == 0
        given = self._plan.inputs
        if given is None or states.first >= len(given):
            ahead = self._acting(int(stamp_ns[-1]))
            effort, offset = (
                np.vstack([states.table[:, columns], [values]])
                for columns, values in ((ACTING, ahead[:2]), (OFFSET, ahead[2:]))
            )
        else:  # what acts may be an earlier message
            own = np.zeros((count + 1, 4))
            for row in np.flatnonzero(wanted).tolist():
                own[row] = self._acting(int(stamp_ns[row]))
            effort, offset = own[:, :2], own[:, 2:]
            later = stamp_ns >= len(given) * self._plan.simulator.period_ns
            wanted &= np.isin(stamp_ns, given.disturbed) | later
        return self._joints(
            topics.DISTURBANCE,
            place[wanted],
            JointStateLayout(self._plan.simulator.joints, 2, 0, 2),
            stamp_ns[wanted],
            position=offset[wanted],
            effort=effort[wanted],
        )

    def _answers(
        self,
        name: str,
        names: tuple[str, ...],
        table: Floats,
        stamp_ns: Integers,
        rows: Integers,
    ) -> Iterator[Rows]:
        """Yield a controller's commands, and its terms, of these names, where they are fresh."""
        yield self._joints(
            topics.EFFORT_COMMAND,
            rows * PLACES + _COMMAND,
            JointStateLayout((self._plan.simulator.joints[1],), 0, 0, 1),
            stamp_ns,
            effort=table[:, EFFORT, None],
        )
        fresh = table[:, FRESH] == 1.0
        yield self._joints(
            topics.controller_state(name),
            rows[fresh] * PLACES + _TERMS,
            JointStateLayout(names, len(names)),
            stamp_ns[fresh],
            position=table[fresh, TERMS : TERMS + len(names)],
        )

    def _joints(
        self,
        topic: str,
        place: Integers,
        layout: JointStateLayout,
        stamp_ns: Integers,
        **quantities: Floats,
    ) -> Rows:
        data = shared(layout).pack_rows(stamp_ns, **quantities)
        return Rows(self._channels[topic], place, stamp_ns, data)


Progress = Callable[[int, int], None]

HAS_FALLEN, HAS_ENDED = "the trunk has fallen", "finished"  # why a run ends


def record_offline(
    plan: RunPlan,
    path: Path,
    overwrite: bool = False,
    progress: Progress = lambda done, of: None,
    origin: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Run the plan and write its recording; return the number of states.

    ``progress`` takes how many states there are by now, and how many there will be. ``origin``: more of the
    provenance.

    Raises DivergedError and OSError as `record_states`.
    """
    stretches = states_of_run(plan)
    return record_states(
        plan, stretches, path, tuple(plan.controllers), overwrite, progress, origin
    )


def record_states(
    plan: RunPlan,
    stretches: Iterable[States],
    path: Path,
    answering: Sequence[str],
    overwrite: bool = False,
    progress: Progress = lambda done, of: None,
    origin: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Write the recording of a plan's run that has these states; return how many there are.

    ``answering``: by name, who gives the commands.

    Raises DivergedError (the file then ends, marked incomplete, with the last finite state), and OSError
    (no file is written then; an existing one stays as it was).
    """
    with atomic_write(path, overwrite=overwrite) as part, RecordingWriter(part) as writer:
        run = OfflineRecorder(plan, answering, writer, origin)
        run.open()
        diverged = run.write_all(stretches, progress)
    if diverged is not None:
        raise diverged
    return run.states


class OfflineRecorder:
    """Records what the nodes would have published, stamped and logged in simulated time."""

    def __init__(
        self,
        plan: RunPlan,
        answering: Sequence[str],
        writer: RecordingWriter,
        origin: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """``answering``: as `record_states`; ``origin``: more of the provenance."""
        self._plan = plan
        self._answering, self._origin = answering, dict(origin)
        self._writer = writer
        pictures = topics.PICTURES if plan.recorder.markers else {}
        self._channels = {
            topic: writer.channel(f"/{topic}", type_name)
            for topic, type_name in (
                topics.evidence_types(tuple(answering)) | dict(pictures)
            ).items()
        }
        if plan.inputs is not None:
            name = f"/{topics.PLANT_INPUTS}"
            self._channels[topics.PLANT_INPUTS] = writer.channel(name, topics.JOINT_STATE_TYPE)
            if plan.inputs.references:
                name = f"/{topics.REFERENCE}"
                self._channels[topics.REFERENCE] = writer.channel(name, topics.JOINT_STATE_TYPE)
        self._pushes = [*plan.pushes]
        self._film = Film() if pictures else None
        # Each source of disturbances is asked at increasing stamps.
        self._messages = StateMessages(plan, self._channels, disturbance_source(plan))
        self._drawn = disturbance_source(plan)
        self._last_ns = -1
        self._reference: float | None = None  # the last that a controller told
        self._of_simulator = plan.timeline("simulator")
        # The next change last, as `Timeline` orders a node's.
        changes = [
            (node, change) for node, node_changes in plan.changes.items() for change in node_changes
        ]
        self._changes = sorted(changes, key=lambda change: change[1].stamp_ns)[::-1]
        self.states = 0

    def _put(self, topic: str, stamp_ns: int, data: bytes) -> None:
        log_time = max(stamp_ns, 0)  # a change before the first state is stamped -1 ns
        self._writer.write(self._channels[topic], log_time, log_time, data)

    def tell(
        self,
        message: Event,
        values: Mapping[str, str],
        node: str = "simulator",
        level: int = 0,
        stamp_ns: int | None = None,
    ) -> None:
        """Write an event, by default at the last state's stamp."""
        at_ns = self._last_ns if stamp_ns is None else stamp_ns
        data = event(at_ns, f"/{node}", message, values, level)
        self._put(topics.RUN_EVENTS, at_ns, data)

    def open(self) -> None:
        """Write provenance and every node's full parameters."""
        plan = self._plan
        self._writer.add_metadata(
            PROVENANCE,
            provenance.gather(
                scenario=plan.scenario,
                controller=" ".join(filter(None, [plan.external, *self._answering])),
                mode="offline",
                rmw="none",
            )
            | self._origin,
        )
        for name, config in plan.configs.items():
            if name != "recorder":
                self.put_parameters(name, config)
        self.tell(Event.STARTED, {"rate": str(plan.simulator.update_rate)})
        if plan.external:
            self.tell(Event.CONNECTED, {"node": f"/{plan.external}"})

    def write_all(self, stretches: Iterable[States], progress: Progress) -> DivergedError | None:
        """Write all states and how the run ends, and finish the file; return why it diverged, if it did."""
        states = states_of(self._plan)
        try:
            for stretch in stretches:
                self.write(stretch)
                progress(self.states, states)
        except DivergedError as error:
            self.put_changes_to_come()
            self.failed(str(error))
            self._writer.finish(complete=False, reason=str(error))
            return error
        fell = len(stretch.table) - 1 in stretch.falls and self._plan.simulator.fall_stop
        words = self._plan.simulator.kind.words
        reason = words(HAS_FALLEN) if fell else HAS_ENDED
        self.put_changes_to_come()
        self.finished(reason)
        self._writer.finish(complete=True, reason=reason)
        return None

    def put_parameters(self, node: str, config: Any) -> None:
        """Write all parameters of a node at its start."""
        self._put(topics.RUN_PARAMETERS, 0, self._parameters(0, node, values_of(config), {}))

    def _parameters(
        self, stamp_ns: int, node: str, new: Mapping[str, Value], changed: Mapping[str, Value]
    ) -> bytes:
        config = config_class(node, {PLANT_NAME: self._plan.simulator.kind.name})
        kinds = {name: d.kind for name, d in declarations(config).items()}
        return parameter_event(stamp_ns, f"/{node}", new, changed, kinds)

    def _changed(self, states: States) -> Iterator[Rows]:
        """Yield the changes that came from outside before these states, as a graph records them."""
        period_ns = self._plan.simulator.period_ns
        while self._changes:
            node, change = self._changes[-1]
            row = max(change.stamp_ns // period_ns + 1 - states.first, 0)
            if row >= len(states.table):
                return
            self._changes.pop()
            for topic, data in self._told(node, change):
                yield self._single(topic, row * PLACES + TURNED, change.stamp_ns, data)

    def _told(self, node: str, change: Change) -> Iterator[tuple[str, bytes]]:
        """Yield the messages that report a change, each with its topic."""
        word = change.event if change.values is None else Event.RETUNED
        yield topics.RUN_EVENTS, event(change.stamp_ns, f"/{node}", word)
        if change.values is not None:
            changed = self._parameters(change.stamp_ns, node, {}, change.values)
            yield topics.RUN_PARAMETERS, changed

    def _pushed(self, stamp_ns: Integers) -> Iterator[Rows]:
        """Yield the pushes that were taken from an operator for the steps from these states."""
        joints, topic = self._plan.simulator.joints, topics.OPERATOR_PUSH
        while self._pushes and self._pushes[0][0] <= stamp_ns[-1]:
            if topic not in self._channels:
                self._channels[topic] = self._writer.channel(f"/{topic}", topics.JOINT_STATE_TYPE)
            at_ns, applied = self._pushes.pop(0)
            sample = JointSample(at_ns, joints, effort=applied)
            data = layout_of(sample).pack(sample)
            row = int(np.searchsorted(stamp_ns, at_ns))
            yield self._single(topic, row * PLACES + TURNED, at_ns, data)

    def put_changes_to_come(self) -> None:
        """Write the changes that come after the last state."""
        while self._changes:
            node, change = self._changes.pop()
            for topic, data in self._told(node, change):
                self._put(topic, change.stamp_ns, data)

    def write(self, states: States) -> None:
        """Write some states, each in the graph's order."""
        stamp_ns = self._messages.stamps(states.first, len(states.table))
        rows = [*self._messages.of(states, stamp_ns), *self._changed(states)]
        rows += self._pushed(stamp_ns)
        for row, name, active in states.turned:
            word = Event.ACTIVATED if active else Event.DEACTIVATED
            before_ns = self._last_ns if row == 0 else int(stamp_ns[row - 1])
            rows.append(self._event_row(row, TURNED, before_ns, word, {}, name))
        drawn = self._due(stamp_ns)
        for row in sorted({*states.falls, *drawn}):
            at_ns = int(stamp_ns[row])
            self._of_simulator.advance(at_ns)
            if row in states.falls:
                limit = self._of_simulator.config.fall_angle
                values = {"angle": str(float(states.table[row, 1])), "limit": str(limit)}
                rows.append(self._event_row(row, FELL, at_ns, Event.FELL, values, level=1))
            if row in drawn:
                rows += self._pictures(states, row, at_ns)
        self._writer.write_rows(rows)
        self._last_ns = int(stamp_ns[-1])
        self.states += len(states.table)

    def _due(self, stamp_ns: Integers) -> list[int]:
        """Return the rows of which there is to be a picture."""
        film, due = self._film, list[int]()
        for row, at_ns in enumerate(stamp_ns.tolist() if film is not None else ()):
            if film is not None and film.is_due(at_ns):
                film.drawn(at_ns)
                due.append(row)
        return due

    def _pictures(self, states: States, row: int, stamp_ns: int) -> Iterator[Rows]:
        """Yield the messages of a state's picture."""
        film, joints, state = self._film or Film(), self._plan.simulator.joints, states.table[row]
        film.reconfigure(values_of(self._of_simulator.config), {})
        if states.acting(row):
            self._reference = float(state[REFERENCE])
        pushed = disturbance_sample(stamp_ns, joints, self._drawn(stamp_ns))
        position, velocity = (tuple(state[columns].tolist()) for columns in (POSITION, VELOCITY))
        truth = JointSample(stamp_ns, joints, position, velocity, (0.0, float(state[APPLIED])))
        for topic, data in film.picture(truth, pushed, self._reference, stamp_ns):
            yield self._single(topic, row * PLACES + PICTURE, stamp_ns, data)

    def _event_row(
        self,
        row: int,
        place: int,
        stamp_ns: int,
        message: Event,
        values: Mapping[str, str],
        node: str = "simulator",
        level: int = 0,
    ) -> Rows:
        data = event(stamp_ns, f"/{node}", message, values, level)
        return self._single(topics.RUN_EVENTS, row * PLACES + place, stamp_ns, data)

    def _single(self, topic: str, place: int, stamp_ns: int, data: bytes) -> Rows:
        return Rows(
            self._channels[topic],
            np.array([place]),
            np.array([max(stamp_ns, 0)]),
            np.frombuffer(data, f"V{len(data)}"),
        )

    def finished(self, reason: str) -> None:
        """Write the event that ends a whole run."""
        self._tell_passed_on()
        self.tell(Event.FINISHED, {"reason": reason, "states": str(self.states)})

    def failed(self, reason: str) -> None:
        """Write the event that ends a run that failed."""
        self._tell_passed_on()
        self.tell(Event.FAILED, {"reason": reason, "states": str(self.states)}, level=2)

    def _tell_passed_on(self) -> None:
        """Write what became of the links' messages, if there are links."""
        if (network := self._plan.simulator.network) is not None:
            self.tell(Event.PASSED_ON, Traffic(network).counts(self.states))
