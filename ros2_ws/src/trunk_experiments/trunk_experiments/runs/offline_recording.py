"""Records an offline run with the topics, schemas and parameters that the graph records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from trunk_control.decide import Answer, state_record
from trunk_control.law import names_of_record
from trunk_msgs_util import provenance, topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value, declarations, values_of
from trunk_msgs_util.picture.film import Film
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.schemas import event, parameter_event
from trunk_msgs_util.recording.writer import PROVENANCE, RecordingWriter
from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.units import step_count
from trunk_msgs_util.whole_file import whole_file
from trunk_sim.disturbances import disturbance_sample
from trunk_sim.simulation import DivergedError

from ..plans.nodes import NODES
from ..plans.plan import RunPlan
from ..plans.timeline import Change
from .offline import Step, disturbance_source, steps

Progress = Callable[[int, int], None]
_TOLD_EVERY = 2000  # states


def record_offline(
    plan: RunPlan, path: Path, overwrite: bool = False, progress: Progress = lambda done, of: None
) -> int:
    """Run the plan and write its recording; return the number of states.

    ``progress`` takes how many states there are by now, and how many there will be.

    Raises DivergedError and OSError as `record_steps`.
    """
    return record_steps(plan, steps(plan), path, tuple(plan.controllers), overwrite, progress)


def record_steps(
    plan: RunPlan,
    taken: Iterable[Step],
    path: Path,
    answering: Sequence[str],
    overwrite: bool = False,
    progress: Progress = lambda done, of: None,
) -> int:
    """Write the recording of a plan's run whose steps these are; return the number of states.

    ``answering``: by name, who gives the commands.

    Raises DivergedError (the file then ends, marked incomplete, with the last finite state), and OSError
    (no file is written then; an existing one stays as it was).
    """
    diverged = None
    states = step_count(plan.simulator.duration, plan.simulator.update_rate) + 1
    with whole_file(path, overwrite=overwrite) as part, RecordingWriter(part) as writer:
        run = _OfflineRecorder(plan, answering, writer)
        run.open()
        try:
            for step in taken:
                run.write(step)
                if run.states % _TOLD_EVERY == 0:
                    progress(run.states, states)
        except DivergedError as error:
            diverged = error
            run.failed(str(error))
            writer.finish(complete=False, reason=str(error))
        else:
            fell = step.falls and plan.simulator.fall_stop
            reason = "the trunk has fallen" if fell else "finished"
            run.finished(reason)
            writer.finish(complete=True, reason=reason)
            progress(run.states, states)
    if diverged is not None:
        raise diverged
    return run.states


class _OfflineRecorder:
    """Records what the nodes would have published, stamped and logged in simulated time."""

    def __init__(self, plan: RunPlan, answering: Sequence[str], writer: RecordingWriter) -> None:
        self._plan = plan
        self._answering = answering
        self._writer = writer
        self._channels = {
            topic: writer.channel("/" + topic, type_name)
            for topic, type_name in topics.evidence_types(tuple(answering)).items()
        }
        self._film = Film() if plan.recorder.markers else None
        if self._film is not None:
            self._channels |= {
                topic: writer.channel("/" + topic, kind) for topic, kind in topics.PICTURES.items()
            }
        self._acting = disturbance_source(plan)
        self._drawn = disturbance_source(plan)  # each is asked at increasing stamps
        self._last_ns = -1
        self._reference: float | None = None  # the last that a controller told
        self._of_simulator = plan.timeline("simulator")
        self.states = 0

    def _put(self, topic: str, stamp_ns: int, data: bytes) -> None:
        log_time = max(stamp_ns, 0)  # a change before the first state is stamped -1 ns
        self._writer.write(self._channels[topic], log_time, log_time, data)

    def _sample(self, topic: str, sample: JointSample) -> None:
        self._put(topic, sample.stamp_ns, layout_of(sample).pack(sample))

    def _event(
        self, message: Event, values: Mapping[str, str], node: str = "simulator", level: int = 0
    ) -> None:
        data = event(self._last_ns, f"/{node}", message, values, level=level)
        self._put(topics.RUN_EVENTS, self._last_ns, data)

    def open(self) -> None:
        """Write provenance and every node's full parameters."""
        plan = self._plan
        self._writer.add_metadata(
            PROVENANCE,
            provenance.gather(
                scenario=plan.scenario,
                controller=" ".join(self._answering),
                mode="offline",
                rmw="none",
            ),
        )
        for name, config in plan.configs.items():
            if name != "recorder":
                self._parameters(0, name, values_of(config), {})
        for name, changes in plan.changes.items():
            for change in changes:
                self._change(name, change)
        self._event(Event.STARTED, {"rate": str(plan.simulator.update_rate)})

    def _parameters(
        self, stamp_ns: int, node: str, new: Mapping[str, Value], changed: Mapping[str, Value]
    ) -> None:
        kinds = {name: d.kind for name, d in declarations(NODES[node].config).items()}
        data = parameter_event(stamp_ns, f"/{node}", new, changed, kinds)
        self._put(topics.RUN_PARAMETERS, stamp_ns, data)

    def _change(self, node: str, change: Change) -> None:
        """Write what came from outside, as in the original recording."""
        word = change.event if change.values is None else Event.RETUNED
        data = event(change.stamp_ns, f"/{node}", word)
        self._put(topics.RUN_EVENTS, change.stamp_ns, data)
        if change.values is not None:
            self._parameters(change.stamp_ns, node, {}, change.values)

    def write(self, step: Step) -> None:
        """Write one step, in the graph's order."""
        plan, stamp_ns = self._plan, step.stamp_ns
        for name, active in step.turned:
            self._event(Event.ACTIVATED if active else Event.DEACTIVATED, {}, name)
        self._sample(topics.GROUND_TRUTH, step.truth)
        if self.states == 0:
            self._disturbance(stamp_ns)
        self._disturbance(stamp_ns + plan.simulator.period_ns)
        self._sample(topics.JOINT_STATES, step.measured)
        if step.answer is not None:
            self._answer(step, step.answer)
        self._last_ns = stamp_ns
        self._mark_fall(step)
        if self._film is not None and self._film.is_due(stamp_ns):
            self._draw(self._film, step)
        self.states += 1

    def _draw(self, film: Film, step: Step) -> None:
        """Write the state's picture."""
        self._of_simulator.advance(step.stamp_ns)
        film.retune(values_of(self._of_simulator.config))
        joints, acting = self._plan.simulator.joints, self._drawn(step.stamp_ns)
        if step.answer is not None:
            self._reference = step.answer.reference
        pushed = disturbance_sample(step.stamp_ns, joints, acting)
        for topic, data in film.picture(step.truth, pushed, self._reference, step.stamp_ns):
            self._put(topic, step.stamp_ns, data)

    def _answer(self, step: Step, answer: Answer) -> None:
        """Write a controller's command, and its terms if they are fresh."""
        joint = self._plan.simulator.joints[1]  # of every controller: `check_joints`
        command = JointSample(step.stamp_ns, (joint,), effort=(answer.effort,))
        self._sample(topics.EFFORT_COMMAND, command)
        if answer.fresh:
            joints = self._plan.simulator.joints
            values = state_record(answer, step.measured.position[joints.index(joint)])
            self._sample(
                topics.controller_state(step.controller),
                JointSample(step.stamp_ns, names_of_record(answer.terms), position=values),
            )

    def _disturbance(self, stamp_ns: int) -> None:
        """Write the disturbance at a stamp: like the node, one step ahead of the state."""
        if self._plan.disturbance is not None:
            joints = self._plan.simulator.joints
            sample = disturbance_sample(stamp_ns, joints, self._acting(stamp_ns))
            self._sample(topics.DISTURBANCE, sample)

    def _mark_fall(self, step: Step) -> None:
        if step.falls:
            self._of_simulator.advance(step.stamp_ns)
            values = {
                "angle": str(step.truth.position[1]),
                "limit": str(self._of_simulator.config.fall_angle),
            }
            self._event(Event.FELL, values, level=1)

    def finished(self, reason: str) -> None:
        """Write the event that ends a whole run."""
        self._event(Event.FINISHED, {"reason": reason, "states": str(self.states)})

    def failed(self, reason: str) -> None:
        """Write the event that ends a run that failed."""
        self._event(Event.FAILED, {"reason": reason, "states": str(self.states)}, level=2)
