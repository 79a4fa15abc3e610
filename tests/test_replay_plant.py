"""The plant's replay: runs over links, in real time, pushed by hand, with gaps, and gone on with."""

from __future__ import annotations

import struct
from dataclasses import replace
from itertools import pairwise
from math import inf, nextafter

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay import replay
from trunk_experiments.replay.replay_plant import PlantReplay
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.samples import JointSample
from trunk_sim.disturbances import Disturbance
from trunk_sim.operator_input import Applied, with_operator
from trunk_sim.simulation import DivergedError

from .edited import NONE, copied
from .replay_ways import WAYS, replay_this_way

pytestmark = pytest.mark.slow

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
PUSHES = ((13 * MS, Applied(3.0, 5.0)), (20 * MS, Applied(0.0, -4.0)), (40 * MS, Applied(2.0, 0.0)))


@pytest.fixture(autouse=True, params=WAYS)
def way(request, monkeypatch):
    replay_this_way(request.param, monkeypatch)
    return request.param


def planned(*settings, duration=0.06, **everywhere):
    everywhere |= {"duration": duration, "update_rate": 1000.0}
    return make_plan("fig8", "pid", settings=(*DISTURBED, *settings), everywhere=everywhere)


def recorded(plan, path):
    record_offline(plan, path)
    return path


CHANGES = {
    "simulator": [
        Change(25 * MS, {"sensor.velocity_bias": 0.2, "plant.length": 1.1}),
        Change(45 * MS, None, Event.RESET),
    ]
}


@pytest.fixture(scope="module")
def linked(tmp_path_factory):
    plan = replace(planned(*SENSORS, *LINKS), changes=CHANGES)
    return recorded(plan, tmp_path_factory.mktemp("replay") / "linked.mcap")


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """Return a run that somebody pushes, each time for 10 ms; nothing delays or hides what acts."""
    limits = {"operator.force": 10.0, "operator.torque": 10.0, "operator.timeout": 0.01}
    plan = replace(planned(**limits), pushes=PUSHES)
    return recorded(plan, tmp_path_factory.mktemp("replay") / "pushed.mcap")


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


@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_links_and_pushes_follow_from_the_record(linked, pushed, way, provenance):
    assert follows(linked, way, provenance=provenance)
    assert follows(pushed, way, provenance=provenance)


@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_the_torque_of_a_weak_and_slow_drive_follows(tmp_path, way, provenance):
    """Where time is exact, it is made of the command; in real time it is the recorded one."""
    drive = ("simulator.actuator.time_constant=0.004", "simulator.max_effort=3.0")
    path = recorded(planned(*drive), tmp_path / "drive.mcap")
    torques = RecordedRun.open(path).table(TRUTH).values("effort")[:, 1]
    assert abs(torques).max() <= 3.0 < abs(commanded(path)).max()
    assert follows(path, way, provenance=provenance)


def commanded(path):
    return RecordedRun.open(path).table("effort_command").values("effort")[:, 0]


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
    """Before the first message came, what acts here is not nothing: those states differ."""
    run = RecordedRun(
        copied(pushed, pushed.with_suffix(".late"), shifted_back(by), NONE, provenance=REAL_TIME)
    )
    assert {d.stamp_ns for d in found(run)} <= {k * MS for k in range(by + 1)}
    exact = RecordedRun(copied(pushed, pushed.with_suffix(".early"), shifted_back(by), NONE))
    assert len({d.stamp_ns for d in found(exact)}) > 30


def test_in_real_time_a_disturbance_may_act_late_in_what_a_link_brings_late(tmp_path):
    """The sensors' offsets are of the step in which they were read, whatever acted there."""
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


def planted(path, topic, row, quantity, column, **copy):
    """Return the run with the last bit of one number of one message changed."""
    table = RecordedRun.open(path).table(topic)
    values = {q: table.values(q)[row].tolist() for q in ("position", "velocity", "effort")}
    values[quantity][column] = nextafter(values[quantity][column], inf)
    sample = JointSample(table.stamps[row], tuple(table.names), **values)

    def edit(messages):
        of(messages, topic)[row][2] = layout_of(sample).pack(sample)

    return RecordedRun(copied(path, path.with_suffix(".planted"), edit, NONE, **copy))


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
def test_one_bit_of_what_a_link_brings_is_found(linked, quantity, column, name, provenance):
    run = planted(linked, MEASURED, 35, quantity, column, provenance=provenance)
    assert [(d.stamp_ns, d.topic, d.field) for d in found(run)] == [(35 * MS, MEASURED, name)]


def test_a_command_acts_where_its_link_brings_it(linked):
    """One bit of a command shows in the states after the steps that used it."""
    run = planted(linked, "effort_command", 30, "effort", 0)
    differ = sorted({d.stamp_ns for d in found(run)})
    told = [PlantReplay(run)._wire.told_ns(k * MS) for k in range(STATES)]
    assert differ == [(k + 1) * MS for k in range(STATES - 1) if told[k] == 30 * MS]
    assert differ
    assert differ[0] > 31 * MS


def test_a_bit_of_a_real_time_torque_is_not_that_of_the_reading(pushed):
    run = planted(pushed, TRUTH, 30, "effort", 1, provenance=REAL_TIME)
    assert [(d.stamp_ns, d.topic, d.field) for d in found(run)] == [
        (30 * MS, MEASURED, "effort[trunk]")
    ]


@pytest.mark.parametrize(("number", "first"), [(0, 14), (1, 21)])
def test_a_push_that_was_another_is_found(pushed, number, first):
    def edit(messages):
        message = of(messages, "operator/push")[number]
        (torque,) = struct.unpack("<d", message[2][-8:])
        message[2] = message[2][:-8] + struct.pack("<d", torque + 1.0)

    run = RecordedRun(copied(pushed, pushed.with_suffix(".push"), edit, NONE))
    assert min(d.stamp_ns for d in found(run)) == first * MS


def test_without_the_state_that_a_link_brings_nothing_is_said_of_the_reading(linked):
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


def test_an_event_of_a_fall_is_found_missing_only_where_falls_are_told(tmp_path):
    """Recordings that do not know the parameter tell of no fall."""
    plan = planned()
    simulator = replace(plan.simulator, fall_angle=0.9, initial_position=(0.0, 1.0))
    path = recorded(replace(plan, simulator=simulator), tmp_path / "fallen.mcap")

    def edit(messages):
        messages[:] = [m for m in messages if m[0] != "/run/events" or b"fell" not in m[2]]

    run = RecordedRun(copied(path, path.with_suffix(".edited"), edit, NONE))
    assert {(d.field, d.recorded, d.computed) for d in found(run)} == {("fell", 0.0, 1.0)}
    run.parameters["simulator"].pop("fall.angle")
    assert found(run) == []

    def moved(messages):
        for message in of(messages, "run/events"):
            if b"fell" in message[2]:
                stamped(message, 5 * MS)

    run = RecordedRun(copied(path, path.with_suffix(".moved"), moved, NONE))
    assert [(d.stamp_ns, d.field, d.recorded, d.computed) for d in found(run)] == [
        (0, "fell", 0.0, 1.0),
        (5 * MS, "fell", 1.0, 0.0),
    ]


def test_a_run_that_diverges_ends_with_its_last_state(tmp_path):
    plan = planned("pid.gains.d=1e5", duration=0.5)
    path = tmp_path / "diverges.mcap"
    with pytest.raises(DivergedError):
        record_offline(plan, path)
    run = RecordedRun.open(path)
    assert run.count(TRUTH) < 501
    assert found(run) == []
    assert steps(run) == run.count(TRUTH)


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


def test_what_was_measured_acts_on_the_step_too(tmp_path):
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


def test_where_a_command_is_missing_in_real_time_an_earlier_one_is_on_its_way(linked, tmp_path):
    def edit(messages):
        messages.remove(of(messages, "effort_command")[33])

    copy = copied(linked, tmp_path / "missing.mcap", edit, NONE, provenance=REAL_TIME)
    replayed = PlantReplay(RecordedRun(copy), 34 * MS)
    assert found_by(replayed) == []
    sent = [effort for _, effort in replayed._sent()]
    efforts = commanded(linked).tolist()
    assert sent == [*efforts[:33], efforts[32]]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return a run in which nobody acts from 20 ms to 50 ms, for which a command holds 10 ms."""
    plan = planned(command_timeout=0.01)
    second = make_plan("fig8", "lqr", everywhere={"update_rate": 1000.0}).controllers["lqr"]
    plan = replace(
        plan,
        controllers={**plan.controllers, "lqr": replace(second, autostart=False)},
        changes={
            "pid": (Change(20 * MS, None, Event.DEACTIVATED),),
            "lqr": (Change(50 * MS, None, Event.ACTIVATED),),
        },
    )
    return recorded(plan, tmp_path_factory.mktemp("replay") / "alone.mcap")


def test_where_nobody_answers_the_last_command_holds_until_it_is_too_old(alone, way):
    assert follows(alone, way)
    run = RecordedRun.open(alone)
    assert run.count("effort_command") == STATES - 30
    torques = run.table(TRUTH).values("effort")[:, 1]
    assert len(set(torques[21:32])) == 1
    assert set(torques[32:52]) == {0.0}
    edited = planted(alone, TRUTH, 25, "effort", 1)
    assert {d.stamp_ns for d in found(edited)} == {25 * MS}


@pytest.mark.parametrize("at", [0, 1, 12, 30, 46, 59])
def test_a_simulation_goes_on_as_the_run_did(linked, pushed, alone, at):
    for path in (linked, pushed, alone):
        run = RecordedRun.open(path)
        replayed = PlantReplay(run, at * MS)
        assert found_by(replayed) == []
        simulation = replayed.resumed()
        truth, measured = run.table(TRUTH), run.table(MEASURED)
        assert [change.stamp_ns for change in replayed.to_come] == [
            one.stamp_ns for one in run.changes("simulator") if one.stamp_ns >= at * MS
        ]
        for k in range(at, min(at + 8, STATES)):
            if any(change.stamp_ns == (k - 1) * MS and k > at for change in replayed.to_come):
                break  # what happens then is for whoever goes on
            acting = replay.acting_at(run.table("disturbance"), k * MS)
            said, seen = simulation.truth(), simulation.measure(acting)
            for sample, table in ((said, truth), (seen, measured)):
                for quantity in ("position", "velocity", "effort"):
                    wanted = table.values(quantity)[k].tolist()
                    assert list(getattr(sample, quantity)) == wanted, (path.name, k, quantity)
            assert simulation.falls_now == any(
                e.message == Event.FELL and e.stamp_ns == k * MS for e in run.events
            )
            command = replayed._torques.command(k * MS)
            assert command is not None
            simulation.step(command, with_operator(acting, run.operated.at(k * MS)))


@pytest.mark.parametrize("provenance", [{}, REAL_TIME], ids=["exact", "real time"])
def test_what_is_as_recorded_is_passed_over(pushed, alone, way, provenance):
    """But for the last state, which no step follows."""
    longest = {"step by step": 1, "by windows": 7, "by stretches": STATES - 1}[way]
    path = copied(pushed, pushed.with_suffix(".whole"), digests=NONE, provenance=provenance).path
    runs = [path] if provenance else [path, alone]
    for run in map(RecordedRun.open, runs):
        checked = list(PlantReplay(run))
        whole, rest = divmod(STATES - 1, longest)
        assert [one.steps for one in checked] == [*[longest] * whole, *[rest] * bool(rest), 1]
        for before, after in pairwise(checked):
            end = before.stamp_ns if before.last_ns is None else before.last_ns
            assert after.stamp_ns == end + MS


@pytest.mark.parametrize(
    ("substeps", "cost"), [(1, 1), (3, 1), (6, 3)], ids=["one", "three", "six"]
)
def test_when_stretches_are_worth_compiling(pushed, substeps, cost, monkeypatch):
    """A state with two Runge-Kutta steps costs what an update of a law costs."""
    run = RecordedRun.open(pushed)
    replayed, plant = PlantReplay(run), run.config("simulator").plant._replace(substeps=substeps)
    for least, worth in ((cost * STATES, True), (cost * STATES + 1, False)):
        monkeypatch.setattr(replay, "WORTH_COMPILING", least)
        assert replayed._windows.are_worthwhile(plant) is worth


def test_a_reading_is_of_the_sensors_as_they_were_then(linked):
    """A link brings it after the sensors have changed: a forger takes them as they are now."""
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
