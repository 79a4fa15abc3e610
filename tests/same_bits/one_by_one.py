"""Recording a run as the nodes would: message by message, from states one by one."""

from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

from ros2_ws.src.trunk_runs.test.stepwise import steps

from trunk_control.decide import state_record
from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.parameters.declarations import values_of
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_recording.cdr import layout_of
from trunk_recording.schemas import event
from trunk_runs import offline_recording
from trunk_runs.loop import disturbance_source
from trunk_runs.offline_recording import record_states
from trunk_runs.plan import RunPlan
from trunk_sim.disturbances import disturbance_sample
from trunk_sim.simulation import DivergedError


class OneByOne(offline_recording.OfflineRecorder):
    """Writes each message when its step is computed."""

    def __init__(self, plan, *given):
        super().__init__(plan, *given)
        self._acting = disturbance_source(plan)

    def put(self, topic, sample):
        at = sample.stamp_ns
        self._writer.write(self._channels[topic], at, at, layout_of(sample).pack(sample))

    def say(self, message, values, node="simulator", level=0):
        data = event(self._last_ns, f"/{node}", message, values, level=level)
        at = max(self._last_ns, 0)
        self._writer.write(self._channels[topics.RUN_EVENTS], at, at, data)

    def disturb(self, stamp_ns):
        if self._plan.disturbance is not None:
            sample = disturbance_sample(
                stamp_ns, self._plan.simulator.joints, self._acting(stamp_ns)
            )
            self.put(topics.DISTURBANCE, sample)

    def write(self, states):
        step = states.step
        while self._changes and self._changes[-1][1].stamp_ns < step.stamp_ns:
            node, change = self._changes.pop()
            for topic, data in self._told(node, change):
                self._put(topic, change.stamp_ns, data)
        for name, active in step.turned:
            self.say(Event.ACTIVATED if active else Event.DEACTIVATED, {}, name)
        self.put(topics.GROUND_TRUTH, step.truth)
        if self.states == 0:
            self.disturb(0)
        self.disturb(step.stamp_ns + self._plan.simulator.period_ns)
        self.put(topics.JOINT_STATES, step.measured)
        if step.answer is not None:
            joint = self._plan.controllers[step.controller].joint
            command = JointSample(step.stamp_ns, (joint,), effort=(step.answer.effort,))
            self.put(topics.EFFORT_COMMAND, command)
            if step.answer.updated:
                values = state_record(step.answer, step.measured.position[1])
                names = law_named(step.controller).record_names
                terms = JointSample(step.stamp_ns, names, position=values)
                self.put(topics.controller_state(step.controller), terms)
        self._last_ns = step.stamp_ns
        if step.falls:
            self._of_simulator.advance(step.stamp_ns)
            limit = self._of_simulator.config.fall_angle
            values = {"angle": str(step.truth.position[1]), "limit": str(limit)}
            self.say(Event.FELL, values, level=1)
        if self._film is not None and self._film.is_due(step.stamp_ns):
            self.draw(step)
        self.states += 1

    def draw(self, step):
        self._of_simulator.advance(step.stamp_ns)
        self._film.reconfigure(values_of(self._of_simulator.config), {})
        if step.answer is not None:
            self._reference = step.answer.reference
        pushed = disturbance_sample(
            step.stamp_ns, self._plan.simulator.joints, self._drawn(step.stamp_ns)
        )
        made = self._film.picture(step.truth, pushed, self._reference, step.stamp_ns)
        for topic, data in made:
            self._writer.write(self._channels[topic], step.stamp_ns, step.stamp_ns, data)


def record_one_by_one(plan: RunPlan, path: Path) -> None:
    """Record a run; one that diverges ends with its last finite state."""
    each = (SimpleNamespace(step=s, table=[0], falls=[0] * s.falls) for s in steps(plan))
    with patch.object(offline_recording, "OfflineRecorder", OneByOne), suppress(DivergedError):
        record_states(plan, each, path, tuple(plan.controllers), overwrite=True)
