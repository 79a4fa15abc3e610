"""Files written in bulk, from CPython or compiled code, equal those written message by message."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from trunk_control.decide import state_record
from trunk_control.laws import law_named
from trunk_experiments.errors import PlanError
from trunk_experiments.plans.plan import Swap, make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.runs import engine, offline_recording
from trunk_experiments.runs.engine import states_of_run
from trunk_experiments.runs.loop_inputs import disturbance_source
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import provenance, topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import values_of
from trunk_msgs_util.provenance import ARITHMETIC
from trunk_msgs_util.recording import writer
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.schemas import event
from trunk_msgs_util.samples import JointSample
from trunk_sim.disturbances import disturbance_sample
from trunk_sim.simulation import DivergedError

from .random_plans import random_plan
from .stepwise import steps

NOISE = ("position_noise=0.01", "velocity_noise=0.02", "delay=0.013")


def plan_of(name, duration=0.6, settings=(), swaps=()):
    scenario, controller = name.split()
    everywhere = {"duration": duration}
    return make_plan(scenario, controller, settings=settings, everywhere=everywhere, swaps=swaps)


def short(name):
    return plan_of(name, duration=0.2)


def with_changes():
    plan = plan_of("fig8 pid")
    changes = [Change(100_000_000, {"gains.p": 50.0}), Change(300_000_000, None)]
    limited = [Change(150_000_000, {"max_effort": 20.0}), Change(400_000_000, None)]
    return replace(plan, changes={"pid": changes, "simulator": limited})


def with_references():
    plan = plan_of("fig8 pid", settings=["pid.reference.profile=topic"])
    return replace(plan, references={k * 10_000_000: 0.02 * k for k in range(30)})


def with_fewer_updates():
    plan = plan_of("fig8 fuzzy_pid")
    config = plan.controllers["fuzzy_pid"]
    return plan.with_controller(replace(config, update_rate=config.update_rate / 3))


def with_pictures(plan):
    return replace(plan, recorder=replace(plan.recorder, markers=True))


PLANS = {
    "pictures": lambda: with_pictures(plan_of("fig9 pid", swaps=[Swap(0.25, "lqr")])),
    **{
        name: (lambda name=name: short(name))
        for name in ("fig6 pid", "fig7 fuzzy_pid", "fig9 computed_torque")
    },
    "noise and delay": lambda: plan_of(
        "fig8 pid", settings=[f"simulator.sensor.{one}" for one in NOISE]
    ),
    "swaps": lambda: plan_of(
        "fig8 pid", swaps=[Swap(0.1, "lqr"), Swap(0.2503, "pid"), Swap(0.4, "fuzzy_pid")]
    ),
    "a fall": lambda: plan_of("fig8 pid", settings=["simulator.fall.angle=0.53"], duration=2.0),
    "an end by a fall": lambda: plan_of(
        "fig8 pid", settings=["simulator.fall.angle=0.53", "simulator.fall.stop=true"], duration=2.0
    ),
    "divergence": lambda: plan_of("fig8 pid", settings=["pid.gains.d=5000"], duration=2.0),
    "fewer updates": with_fewer_updates,
    "random 3": lambda: random_plan(3),
}
BY_HAND = {
    "changes and pictures": lambda: with_pictures(with_changes()),
    "changes": with_changes,
    "references": with_references,
}


@pytest.fixture(autouse=True)
def same_origin(monkeypatch):
    monkeypatch.setattr(provenance, "gather", lambda **given: {**given, "arithmetic": ARITHMETIC})


def one_by_one(plan, path):
    """Record a run as the nodes would: message by message."""
    record_offline_of = offline_recording.OfflineRecorder
    acting = disturbance_source(plan)
    simulator = plan.simulator

    class OneByOne(record_offline_of):
        def put(self, topic, sample):
            at = sample.stamp_ns
            self._writer.write(self._channels[topic], at, at, layout_of(sample).pack(sample))

        def say(self, message, values, node="simulator", level=0):
            data = event(self._last_ns, f"/{node}", message, values, level=level)
            at = max(self._last_ns, 0)
            self._writer.write(self._channels[topics.RUN_EVENTS], at, at, data)

        def disturb(self, stamp_ns):
            if plan.disturbance is not None:
                sample = disturbance_sample(stamp_ns, simulator.joints, acting(stamp_ns))
                self.put(topics.DISTURBANCE, sample)

        def write(self, step):
            while self._changes and self._changes[-1][1].stamp_ns < step.stamp_ns:
                node, change = self._changes.pop()
                for topic, data in self._told(node, change):
                    self._put(topic, change.stamp_ns, data)
            for name, active in step.turned:
                self.say(Event.ACTIVATED if active else Event.DEACTIVATED, {}, name)
            self.put(topics.GROUND_TRUTH, step.truth)
            if self.states == 0:
                self.disturb(0)
            self.disturb(step.stamp_ns + simulator.period_ns)
            self.put(topics.JOINT_STATES, step.measured)
            if step.answer is not None:
                joint = plan.controllers[step.controller].joint
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
            self._film.reconfigure(values_of(self._of_simulator.config))
            if step.answer is not None:
                self._reference = step.answer.reference
            pushed = disturbance_sample(step.stamp_ns, simulator.joints, self._drawn(step.stamp_ns))
            made = self._film.picture(step.truth, pushed, self._reference, step.stamp_ns)
            for topic, data in made:
                self._writer.write(self._channels[topic], step.stamp_ns, step.stamp_ns, data)

    class Fell:
        """What `record_offline` asks of the last states."""

        def __init__(self, step):
            self.step, self.table, self.falls = step, [0], [0] if step.falls else []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(offline_recording, "OfflineRecorder", OneByOne)
        patch.setattr(OneByOne, "write", lambda self, some, w=OneByOne.write: w(self, some.step))
        patch.setattr(offline_recording, "states_of_run", lambda p: map(Fell, steps(p)))
        return outcome(plan, path)


def outcome(plan, path):
    """Return how recording a plan ended, and the file's bytes, if there is one."""
    try:
        ended = record_offline(plan, path)
    except (DivergedError, PlanError) as error:
        ended = repr(error)
    return ended, path.read_bytes() if path.exists() else None


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize("name", [*PLANS, *BY_HAND])
def test_states_in_bulk_make_the_same_file(name, tmp_path, monkeypatch):
    plan = (PLANS | BY_HAND)[name]()
    monkeypatch.setattr(writer, "CHUNK_SIZE", 30_000)  # several chunks in one stretch
    expected = one_by_one(plan, tmp_path / "one_by_one.mcap")
    monkeypatch.setattr(engine, "longest", lambda substeps: 70)
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: False)
    assert outcome(plan, tmp_path / "in_bulk.mcap") == expected
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: True)
    monkeypatch.setattr(engine, "_plain_code", None)  # CPython's must not be called
    assert outcome(plan, tmp_path / "compiled.mcap") == expected


def test_cpython_does_it_where_numba_is_missing(monkeypatch):
    plan = short("fig7 pid")
    for name in {"numba", *(name for name in sys.modules if name.startswith("numba."))}:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: True)
    assert sum(len(states.table) for states in states_of_run(plan)) == 201
    with pytest.raises(ImportError):
        list(states_of_run(plan, compiled=True))


def test_short_runs_do_not_load_the_compiler():
    assert not engine.worth_compiling(short("fig8 pid").simulator)
    assert engine.worth_compiling(plan_of("fig8 pid", duration=10.0).simulator)
