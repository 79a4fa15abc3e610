"""The plant's replay of runs over links and of runs that are pushed by hand, with gaps and bits planted."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.samples import JointSample
from trunk_sim.disturbances import Disturbance

from ..edited import NONE, copied
from .runs import (
    MEASURED,
    MS,
    REAL_TIME,
    SENSORS,
    STATES,
    TRUTH,
    follows,
    found,
    found_by,
    of,
    planned,
    planted,
    recorded,
)

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_links_and_pushes_follow_from_the_record(linked, pushed, way, provenance):
    assert follows(linked, way, provenance=provenance)
    assert follows(pushed, way, provenance=provenance)


@pytest.mark.parametrize(
    ("quantity", "column", "name"),
    [
        ("position", 0, "position[hip]"),
        ("velocity", 1, "velocity[trunk]"),
        ("effort", 0, "effort[hip]"),
        ("effort", 1, "effort[trunk]"),
    ],
)
@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_one_bit_of_a_reading_over_a_link_is_found(linked, quantity, column, name, provenance):
    run = planted(linked, MEASURED, 35, quantity, column, provenance=provenance)
    assert [(d.stamp_ns, d.topic, d.field) for d in found(run)] == [(35 * MS, MEASURED, name)]


def test_a_command_acts_when_its_link_delivers_it(linked):
    """One bit of a command shows in the states after the steps that used it."""
    run = planted(linked, "effort_command", 30, "effort", 0)
    differ = sorted({d.stamp_ns for d in found(run)})
    told = [PlantReplay(run)._wire.told_ns(k * MS) for k in range(STATES)]
    assert differ == [(k + 1) * MS for k in range(STATES - 1) if told[k] == 30 * MS]
    assert differ
    assert differ[0] > 31 * MS


@pytest.mark.parametrize(("number", "first"), [(0, 14), (1, 21)])
def test_an_edited_push_is_found(pushed, number, first):
    def edit(messages):
        message = of(messages, "operator/push")[number]
        (torque,) = struct.unpack("<d", message[2][-8:])
        message[2] = message[2][:-8] + struct.pack("<d", torque + 1.0)

    run = RecordedRun(copied(pushed, pushed.with_suffix(".push"), edit, NONE))
    assert min(d.stamp_ns for d in found(run)) == first * MS


def test_a_reading_whose_state_is_missing_is_not_judged(linked):
    """Two rows of the truth are gone: neither what was read there, nor what followed, is judged by them."""

    def edit(messages):
        for one in of(messages, TRUTH)[30:32]:
            messages.remove(one)

    run = RecordedRun(copied(linked, linked.with_suffix(".gone"), edit, NONE))
    replayed = PlantReplay(run)
    checked = list(replayed)
    assert sum(one.steps for one in checked) == STATES - 2
    seen_there = [
        k * MS for k in range(32, STATES) if replayed._wire.seen_ns(k * MS) in (30 * MS, 31 * MS)
    ]
    assert seen_there
    of_readings = {d.stamp_ns for one in checked for d in one.found if d.topic == MEASURED}
    assert not of_readings & set(seen_there)


def test_changes_before_the_first_state_act_on_it_and_those_at_it_on_the_next(tmp_path, way):
    changes = [
        Change(-1, {"sensor.position_bias": 0.3, "plant.length": 1.2}),
        Change(0, {"sensor.position_bias": 0.7, "plant.length": 1.3}),
    ]
    plan = replace(planned(*SENSORS), changes={"simulator": changes})
    path = recorded(plan, tmp_path / "changed.mcap")
    seen = RecordedRun.open(path).table(MEASURED).values("position")[:, 1]
    assert seen[1] - seen[0] == pytest.approx(0.4, abs=0.02)
    assert follows(path, way)


def test_a_late_reading_uses_the_sensors_of_its_time(linked):
    """A link delivers it after the sensors have changed; a forger would take them as they are now."""
    replayed = PlantReplay(RecordedRun.open(linked))
    assert found_by(replayed) == []
    row = next(k for k in range(26, STATES) if replayed._wire.seen_ns(k * MS) == 25 * MS)
    states, before = replayed._states, replayed._states.reading(25, Disturbance())
    states.forget_before(0, states._epochs[-1].sensor)
    forged = states.reading(25, Disturbance()).theta_dot - before.theta_dot
    assert forged == pytest.approx(0.1)
    table = RecordedRun.open(linked).table(MEASURED)
    values = {q: table.values(q)[row].tolist() for q in ("position", "velocity", "effort")}
    values["velocity"][1] = states.reading(
        25, replay.acting_at(RecordedRun.open(linked).table("disturbance"), 25 * MS)
    ).theta_dot
    sample = JointSample(table.stamps[row], tuple(table.names), **values)

    def edit(messages):
        of(messages, MEASURED)[row][2] = layout_of(sample).pack(sample)

    run = RecordedRun(copied(linked, linked.with_suffix(".forged"), edit, NONE))
    assert [(d.stamp_ns, d.topic, d.field) for d in found(run)] == [
        (row * MS, MEASURED, "velocity[trunk]")
    ]
