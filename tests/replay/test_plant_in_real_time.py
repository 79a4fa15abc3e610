"""The plant's replay of runs in real time: a disturbance acts late, a torque is the recorded one."""

from __future__ import annotations

import struct

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.samples import JointSample

from ..edited import NONE, copied
from .runs import (
    LINKS,
    MEASURED,
    MS,
    REAL_TIME,
    STATES,
    TRUTH,
    commanded,
    follows,
    found,
    found_by,
    of,
    planned,
    planted,
    recorded,
    stamped,
)

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_the_torque_of_a_weak_and_slow_drive_follows(tmp_path, way, provenance):
    """Where time is exact, it is computed from the command; in real time it is the recorded one."""
    drive = ("simulator.actuator.time_constant=0.004", "simulator.max_effort=3.0")
    path = recorded(planned(*drive), tmp_path / "drive.mcap")
    torques = RecordedRun.open(path).table(TRUTH).values("effort")[:, 1]
    assert abs(torques).max() <= 3.0 < abs(commanded(path)).max()
    assert follows(path, way, provenance=provenance)


def shifted_back(by):
    """Let each disturbance act some steps after its message's stamp, as a late message does."""

    def edit(messages):
        for message in of(messages, "disturbance"):
            nanosec = struct.unpack_from("<I", message[2], 8)[0]
            if nanosec >= by * MS:
                stamped(message, nanosec - by * MS)
            else:
                messages.remove(message)

    return edit


@pytest.mark.parametrize("by", [1, 4])
def test_in_real_time_a_disturbance_may_act_late(pushed, by):
    """Here a disturbance acts already before the first message came: those states differ."""
    run = RecordedRun(
        copied(pushed, pushed.with_suffix(".late"), shifted_back(by), NONE, provenance=REAL_TIME)
    )
    assert {d.stamp_ns for d in found(run)} <= {k * MS for k in range(by + 1)}
    exact = RecordedRun(copied(pushed, pushed.with_suffix(".early"), shifted_back(by), NONE))
    assert len({d.stamp_ns for d in found(exact)}) > 30


def test_in_real_time_a_disturbance_may_be_late_in_a_late_reading(tmp_path):
    """A reading has the offsets of the step in which it was taken, whatever acted there."""
    offset = (
        "disturbance.pulse.channel=trunk_position",
        "disturbance.pulse.start_times=[0.010]",
        "disturbance.pulse.duration=0.020",
        "disturbance.sine.channel=hip_position",
        "disturbance.sine.amplitude=0.01",
    )
    path = recorded(planned(*LINKS, *offset), tmp_path / "a.mcap")
    late = copied(path, tmp_path / "b.mcap", shifted_back(2), NONE, provenance=REAL_TIME)
    assert all(d.stamp_ns <= 8 * MS for d in found(RecordedRun(late)))
    early = RecordedRun(copied(path, tmp_path / "c.mcap", shifted_back(2), NONE))
    assert len({d.stamp_ns for d in found(early)}) > 30


def test_one_bit_of_a_real_time_torque_differs_from_the_reading(pushed):
    run = planted(pushed, TRUTH, 30, "effort", 1, provenance=REAL_TIME)
    assert [(d.stamp_ns, d.topic, d.field) for d in found(run)] == [
        (30 * MS, MEASURED, "effort[trunk]")
    ]


def test_no_disturbance_acts_again_after_another_one(tmp_path):
    """Two equal pulses acted, and somebody has taken the second one out of the messages."""
    plan = make_plan(
        "fig8",
        "pid",
        settings=[
            "disturbance.pulse.channel=trunk_effort",
            "disturbance.pulse.start_times=[0.01, 0.03]",
            "disturbance.pulse.duration=0.005",
        ],
        everywhere={"duration": 0.06, "update_rate": 1000.0},
    )
    path = recorded(plan, tmp_path / "a.mcap")
    table = RecordedRun.open(path).table("disturbance")
    pulse = [k for k in range(20, STATES) if any(table.get(k * MS, "effort"))]
    assert pulse

    def edit(messages):
        of_stamp = {table.stamps[row]: row for row in range(len(table))}
        for k in pulse:
            names, none = tuple(table.names), (0.0, 0.0)
            sample = JointSample(k * MS, names, none, (), none)
            of(messages, "disturbance")[of_stamp[k * MS]][2] = layout_of(sample).pack(sample)

    run = RecordedRun(copied(path, tmp_path / "b.mcap", edit, NONE, provenance=REAL_TIME))
    assert [d.stamp_ns for d in found(run) if d.field == "velocity[trunk]"] == [
        (k + 1) * MS for k in pulse
    ]


def test_a_reading_and_its_step_share_one_disturbance(tmp_path):
    """In real time: a measurement with the offset of 9 ms does not go with the torque of 10 ms."""
    settings = [
        "disturbance.pulse.channel=trunk_effort",
        "disturbance.pulse.start_times=[0.01]",
        "disturbance.pulse.duration=0.005",
        "disturbance.sine.channel=trunk_position",
        "disturbance.sine.amplitude=0.01",
        "disturbance.sine.frequency=20.0",
    ]
    everywhere = {"duration": 0.06, "update_rate": 1000.0}
    path = recorded(
        make_plan("fig8", "pid", settings=settings, everywhere=everywhere), tmp_path / "a"
    )
    run = RecordedRun.open(path)
    seen = PlantReplay(run)._states.reading(10, replay.acting_at(run.table("disturbance"), 9 * MS))
    table = run.table(MEASURED)
    sample = JointSample(
        10 * MS,
        tuple(table.names),
        (seen.x, seen.theta),
        (seen.x_dot, seen.theta_dot),
        tuple(table.values("effort")[10].tolist()),
    )

    def edit(messages):
        of(messages, MEASURED)[10][2] = layout_of(sample).pack(sample)

    forged = RecordedRun(copied(path, tmp_path / "b", edit, NONE, provenance=REAL_TIME))
    assert {(d.stamp_ns, d.topic) for d in found(forged)} == {(11 * MS, TRUTH)}


def test_where_a_command_is_missing_in_real_time_the_one_before_is_used(linked, tmp_path):
    def edit(messages):
        messages.remove(of(messages, "effort_command")[33])

    copy = copied(linked, tmp_path / "missing.mcap", edit, NONE, provenance=REAL_TIME)
    replayed = PlantReplay(RecordedRun(copy), 34 * MS)
    assert found_by(replayed) == []
    sent = [effort for _, effort in replayed._sent()]
    efforts = commanded(linked).tolist()
    assert sent == [*efforts[:33], efforts[32]]
