"""Short runs, copies of them in which something was changed, and what their replay finds."""

from __future__ import annotations

import struct
from math import inf, nextafter

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.samples import JointSample

from ..edited import NONE, copied

MS = 1_000_000
TRUTH, MEASURED = "ground_truth/joint_states", "joint_states"
REAL_TIME = {"mode": "real_time"}
STATES = 61
DISTURBED = (
    "disturbance.pulse.start_times=[0.01]",
    "disturbance.pulse.duration=0.005",
    "disturbance.sine.channel=hip_effort",
    "disturbance.sine.amplitude=2.0",
    "disturbance.sine.frequency=20.0",
)
SENSORS = (
    "simulator.sensor.delay=0.003",
    "simulator.sensor.position_noise=0.001",
    "simulator.sensor.velocity_bias=0.1",
)
LINKS = (
    "simulator.link.state.delay=3ms",
    "simulator.link.state.jitter=2ms",
    "simulator.link.state.loss=0.2",
    "simulator.link.command.delay=2ms",
    "simulator.link.command.jitter=2ms",
)


def planned(*settings, duration=0.06, **everywhere):
    everywhere |= {"duration": duration, "update_rate": 1000.0}
    return make_plan("fig8", "pid", settings=(*DISTURBED, *settings), everywhere=everywhere)


def recorded(plan, path):
    record_offline(plan, path)
    return path


def found(run):
    return found_by(PlantReplay(run))


def found_by(replayed):
    return [d for one in replayed for d in one.found]


def steps(run):
    return sum(one.steps for one in PlantReplay(run))


def passed_over(run):
    return max(one.steps for one in PlantReplay(run)) > 1


def follows(path, way, **copy):
    """Return whether all states of a run, or of its copy, follow from its record."""
    run = RecordedRun(copied(path, path.with_suffix(".copy"), **copy, digests=NONE))
    assert passed_over(run) == (way != "step by step")
    return found(run) == [] and steps(run) == run.count(TRUTH)


def of(messages, topic):
    return [message for message in messages if message[0] == "/" + topic]


def stamped(message, stamp_ns):
    message[2] = message[2][:4] + struct.pack("<iI", *divmod(stamp_ns, 10**9)) + message[2][12:]


def commanded(path):
    return RecordedRun.open(path).table("effort_command").values("effort")[:, 0]


def planted(path, topic, row, quantity, column, **copy):
    """Return the run with the last bit of one number of one message changed."""
    table = RecordedRun.open(path).table(topic)
    values = {q: table.values(q)[row].tolist() for q in ("position", "velocity", "effort")}
    values[quantity][column] = nextafter(values[quantity][column], inf)
    sample = JointSample(table.stamps[row], tuple(table.names), **values)

    def edit(messages):
        of(messages, topic)[row][2] = layout_of(sample).pack(sample)

    return RecordedRun(copied(path, path.with_suffix(".planted"), edit, NONE, **copy))
