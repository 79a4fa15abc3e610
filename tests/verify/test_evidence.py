"""What acted in a real-time run is on record: no edit of it verifies, and no honest run is accused."""

from dataclasses import replace

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, content, copied, write

from trunk_core.parameters.declarations import declarations
from trunk_core.samples import JointSample
from trunk_core.topics import Event
from trunk_evidence.differences import diff
from trunk_evidence.doubts import doubts_of, refused, unsound
from trunk_evidence.evidence import pulses_of
from trunk_evidence.explanation import explain
from trunk_evidence.judgement import DIVERGES, UNJUDGED, VERIFIED, verify
from trunk_evidence.judgement import verdict_on as verdict_of
from trunk_evidence.recorded_run import RecordedRun, late_steps, not_judged
from trunk_recording.cdr import layout_of
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.schemas import event, parameter_event, parse_parameter_event
from trunk_runs import engine
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import Swap, make_plan
from trunk_runs.timeline import Change

from .. import real_time
from ..real_time import (
    INPUTS,
    changed,
    frame_of,
    in_frame,
    late_inputs,
    record_real_time,
    source_of,
    stamp_at,
)
from ..tampering.check import outcome
from ..tampering.edits import edits_of
from .messages import COMMAND, DISTURBANCE, STATE, TRUTH, of, without

TERMS, PARAMETERS, EVENTS = "/pid/state", "/run/parameters", "/run/events"
PULSE = (
    "disturbance.pulse.channel=trunk_effort",
    "disturbance.pulse.start_times=[0.5]",
    "disturbance.pulse.duration=0.1",
    "disturbance.pulse.magnitude=5.0",
)
H = 5_000_000  # ns


@pytest.fixture(autouse=True)
def engine_kind(monkeypatch):
    """Judge every file with CPython, in several windows: what is compared does not depend on it."""
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: False)
    monkeypatch.setattr(engine, "longest", lambda _: 64)


def plan_of(*settings, **more):
    everywhere = {"duration": 1.0, "update_rate": 200.0}
    return make_plan("fig6", "pid", settings=settings, everywhere=everywhere, **more)


KINDS = {n: d.kind for n, d in declarations(type(plan_of(*PULSE).disturbance)).items()}


@pytest.fixture(scope="module")
def in_time(tmp_path_factory):
    path = tmp_path_factory.mktemp("evidence") / "in_time.mcap"
    record_real_time(plan_of(*PULSE), path)
    return path


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """Return a run in which commands are one and two steps late, and disturbances up to three."""
    path = tmp_path_factory.mktemp("evidence") / "late.mcap"
    plan, steps = plan_of(*PULSE), np.arange(201)
    record_real_time(plan, path, late_inputs(plan, 1 + steps // 7 % 2, steps // 11 % 4))
    return path


def verdict_on(source, path, edit, end=True):
    """Return the verdict on an edited copy, in which all digests and counts are made to fit."""

    def edit_all(messages):
        edit(messages)
        real_time.count(messages)

    return verify(copied(source, path, edit_all, ANEW, end))


def checks(verdict):
    return {check.name: check for check in verdict.checks}


def retune(messages, **values):
    """Change a disturbance's parameters, and its messages' values where its pulse then acts."""
    for message in of(messages, PARAMETERS):
        parameters = parse_parameter_event(message[2])
        if parameters.node == DISTURBANCE:
            new = {**parameters.new, **{name.replace("_", ".", 1): v for name, v in values.items()}}
            message[2] = parameter_event(
                parameters.stamp_ns, parameters.node, new, {}, KINDS, parameters.source
            )
    duration, magnitude = values.get("pulse_duration", 0.1), values.get("pulse_magnitude", 5.0)
    for message in of(messages, DISTURBANCE):
        acts = 0 <= stamp_at(message[2]) - 500_000_000 < round(duration * 1e9)
        effort = np.array([0.0, magnitude if acts else 0.0])
        message[2] = changed(message[2], lambda joints, e=effort: setattr(joints, "effort", e))


@pytest.mark.parametrize("name", ["in_time", "late"])
def test_an_honest_run_verifies_and_so_does_an_edit_of_nothing(name, request, tmp_path):
    source = request.getfixturevalue(name)
    edited = verdict_on(source, tmp_path / "a.mcap", lambda m: retune(m, pulse_duration=0.1))
    for verdict in (verify(Recording.open(source)), edited):
        assert verdict.exit_code == VERIFIED, verdict.reasons
        assert {name: check.steps for name, check in checks(verdict).items()} == {
            "commands of pid": 201,
            "measured states": 201,
            "states of the plant": 201,
            "disturbances": 202,
            "inputs of the plant": 201,
        }


@pytest.mark.parametrize("name", ["in_time", "late"])
@pytest.mark.parametrize(
    "pulse", [{"pulse_magnitude": 500.0}, {"pulse_duration": 0.005}], ids=["500 N m", "cut"]
)
def test_a_pulse_that_did_not_act_like_that_is_not_verified(name, pulse, request, tmp_path):
    source = request.getfixturevalue(name)
    verdict = verdict_on(source, tmp_path / "a.mcap", lambda m: retune(m, **pulse))
    assert verdict.exit_code != VERIFIED
    assert checks(verdict)["inputs of the plant"].wrong_steps


def test_a_difference_names_the_joints_as_the_run_does(tmp_path):
    names = ("simulator.joints=[h,t]", "disturbance.joints=[h,t]", "pid.joint=t")
    record_real_time(plan_of(*PULSE, *names), tmp_path / "run.mcap")
    verdict = verdict_on(
        tmp_path / "run.mcap", tmp_path / "a.mcap", lambda m: retune(m, pulse_magnitude=500.0)
    )
    inputs = checks(verdict)["inputs of the plant"]
    assert inputs.first[0].field == "effort[t] in force"


def test_a_pulse_that_never_acted_is_not_verified(tmp_path):
    """The first state waits for the disturbance node: its first message is in force there."""
    plan, path = plan_of(*PULSE), tmp_path / "run.mcap"
    nothing, never = np.zeros((201, 4)), np.full(201, -1)
    inputs = replace(late_inputs(plan), disturbance=nothing, disturbance_ns=never)
    assert verify(record_real_time(plan, path, inputs)).exit_code == DIVERGES


def test_the_last_command_and_its_terms_are_missed(in_time, tmp_path):
    edit = without(slice(-1, None), COMMAND, TERMS)
    assert verdict_on(in_time, tmp_path / "a.mcap", edit).exit_code != VERIFIED


def edit_row(change):
    """Return an edit of the inputs at t = 0.3 s."""

    def edit(messages):
        row = of(messages, INPUTS)[60]
        row[2] = changed(row[2], change)

    return edit


def put(quantity, value):
    def change(row):
        values = getattr(row, quantity)
        setattr(row, quantity, np.array([value, *values[1:]]))

    return change


def drop(row):
    """Let no command be in force."""
    put("position", 0.0)(row)
    put("velocity", -1.0)(row)
    rename("-")(row)


def rename(source):
    def change(row):
        simulator, _, disturbance = row.header.frame_id.split(" ")
        row.header.frame_id = f"{simulator} {source} {disturbance}"

    return change


ROWS = {
    "a command that is dropped": edit_row(drop),
    "a source that is renamed": edit_row(rename("pid@machine-2")),
    "a source that is left out": edit_row(rename("-")),
    "another age": edit_row(put("velocity", 3.0 * H)),
    "an age from the future": edit_row(put("velocity", -2.0 * H)),
    "a row that is removed": without(slice(60, 61), INPUTS),
    "all rows": without(slice(None), INPUTS),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["in_time", "late"])
@pytest.mark.parametrize("edit", ROWS.values(), ids=ROWS.keys())
def test_no_edit_of_what_acted_is_verified(name, edit, request, tmp_path):
    source = request.getfixturevalue(name)
    assert verdict_on(source, tmp_path / "a.mcap", edit).exit_code != VERIFIED


@pytest.mark.slow
@pytest.mark.one_in(4)
@pytest.mark.parametrize("part", range(8))
@pytest.mark.parametrize("topic", [INPUTS, DISTURBANCE])
def test_edits_of_what_acted_and_was_to_act_are_caught_or_listed(late, topic, part, tmp_path):
    recorded = content(late)
    edits = [edit for edit in edits_of(recorded) if edit.name.startswith(f"{topic} ")]
    assert len(edits) > 80
    found = [outcome("real_time", recorded, each, ANEW, tmp_path) for each in edits[part::8]]
    assert [each.name for each in found if each.wrong] == []


def test_a_pulse_that_was_told_and_never_acted_is_said(tmp_path):
    """Its messages are older ones' in force: `plot` shades what acted."""
    steps = np.arange(201)
    held = late_inputs(plan_of(*PULSE), 0, np.where((steps >= 100) & (steps < 120), steps - 99, 0))
    record_real_time(plan_of(*PULSE), tmp_path / "run.mcap", held)
    run = RecordedRun.open(tmp_path / "run.mcap")
    (said,) = unsound(run)
    assert said == "NOT IN FORCE: disturbance: 5 on trunk_effort, t = 0.5 to 0.6 s, never acted"
    assert (pulses_of(run), verdict_of(run).exit_code) == ([], VERIFIED)


def test_pulses_are_shown_where_they_acted(in_time, late):
    (told,), (acted,) = (pulses_of(RecordedRun.open(path)) for path in (in_time, late))
    assert (told.start, told.end) == (0.5, 0.6)
    assert (acted.start, acted.end) != (0.5, 0.6)
    assert [*unsound(RecordedRun.open(late)), *refused(RecordedRun.open(late))] == []


def test_a_strangers_pushes_accuse_nobody(in_time, tmp_path):
    recorded = content(in_time)
    recorded.channels["/operator/push"] = replace(
        recorded.channels[COMMAND], topic="/operator/push"
    )
    pushes = [["/operator/push", *message[1:]] for message in recorded.of(COMMAND)[:5]]
    recorded.messages += [[*m[:2], in_frame(m[2], ""), *m[3:]] for m in pushes]
    assert verify(write(recorded, tmp_path / "a.mcap", ANEW)).exit_code == VERIFIED


@pytest.mark.parametrize("topic", [COMMAND, DISTURBANCE, STATE])
def test_what_a_stranger_sent_and_nobody_used_does_not_matter(in_time, topic, tmp_path):
    def edit(messages):
        log_ns = of(messages, topic)[50][1]
        sample = JointSample(250_000_000, ("left", "right"), effort=(1.0, 2.0))
        messages.append([topic, log_ns, layout_of(sample).pack(sample), log_ns, 0])

    verdict = verify(copied(in_time, tmp_path / "a.mcap", edit, ANEW))
    assert verdict.exit_code == VERIFIED, verdict.reasons


def test_what_controllers_made_of_a_strangers_states_is_not_known(tmp_path):
    """One from the far future made two controllers take their turns at once."""
    record_real_time(plan_of(swaps=[Swap(0.5, "fuzzy_pid")]), tmp_path / "run.mcap")

    def edit(messages):
        turned = event(300_000_000, "/pid", Event.DEACTIVATED, source=source_of("pid"))
        messages.append([EVENTS, 300_000_000, turned, 300_000_000, 0])
        message = of(messages, STATE)[0]
        far = changed(message[2], lambda joints: setattr(joints.header.stamp, "sec", 1000))
        messages.append([STATE, message[1], in_frame(far, ""), *message[3:]])

    end = {"complete": "false", "reason": "another node publishes states, too"}
    verdict = verdict_on(tmp_path / "run.mcap", tmp_path / "a.mcap", edit, end)
    assert verdict.exit_code == UNJUDGED, verdict.reasons


def test_which_of_two_equal_disturbances_was_in_force_is_not_known(in_time, tmp_path):
    def older(row):
        row.velocity = np.array([row.velocity[0], *[1.0 * H] * 4])

    path = tmp_path / "a.mcap"
    assert verdict_on(in_time, path, edit_row(older)).exit_code == VERIFIED
    assert late_steps(RecordedRun.open(path)).steps == 1


def test_a_fall_left_out_with_its_limit_raised_is_the_same_motion(tmp_path):
    for angle in ("0.01", "3.0"):
        path = tmp_path / f"{angle}.mcap"
        record_real_time(plan_of(f"simulator.fall.angle={angle}"), path)
        assert verify(Recording.open(path)).exit_code == VERIFIED
    fell, stood = (RecordedRun.open(tmp_path / f"{angle}.mcap") for angle in ("0.01", "3.0"))
    assert [e.message for e in fell.events].count(Event.FELL) == 1
    assert (
        fell.table("joint_states").values("position")
        == stood.table("joint_states").values("position")
    ).all()


def test_a_late_run_is_doubtful_and_how_far_it_was_moved_is_known(in_time, late):
    assert not doubts_of(RecordedRun.open(in_time))
    doubts = doubts_of(RecordedRun.open(late))
    assert (doubts.late.steps, doubts.late.of) == (200, 200)
    assert doubts.late.moved_deg > 0.01


def take_back_count(messages):
    """Let the controller not say what it published; what the others say is made to fit."""
    real_time.count(messages)
    words = [m for m in of(messages, EVENTS) if b"published" in m[2] and b"/pid" in m[2]]
    messages.remove(next(m for m in words if frame_of(m[2]).startswith("pid@")))


@pytest.mark.parametrize("topic", [COMMAND, TERMS])
@pytest.mark.parametrize("lost", [1, 2, 5])
def test_what_a_killed_controller_sent_last_may_be_missing(in_time, topic, lost, tmp_path):
    """It did not say what it published; what acted on the plant is known all the same."""

    def kill(messages):
        without(slice(-lost, None), topic)(messages)
        take_back_count(messages)

    verdict = verify(copied(in_time, tmp_path / "a.mcap", kill, ANEW, end=False))
    assert verdict.exit_code == UNJUDGED, verdict.reasons
    assert not any(check.wrong_steps for check in verdict.checks)
    assert checks(verdict)["states of the plant"].result == "verified"
    assert checks(verdict)["states of the plant"].steps == 201


@pytest.mark.parametrize("killed", [True, False])
def test_a_command_that_acted_in_no_step_is_missing_beside_its_terms(late, killed, tmp_path):
    """A complete recording may lack it if nobody counted it, and only then; it is not passed over."""

    def edit(messages):
        without(slice(-1, None), COMMAND)(messages)
        (take_back_count if killed else real_time.count)(messages)

    verdict = verify(copied(late, tmp_path / "a.mcap", edit, ANEW))
    assert verdict.exit_code == (UNJUDGED if killed else DIVERGES)
    says = "t = 1 s: pid/state: a message with this stamp, where none was to be sent"
    assert [says in reason for reason in verdict.reasons] == [True]


def restart(messages, at_ns):
    """Let another process of the controller send from a state on; the first one was killed."""
    second = real_time.source_of("pid", 2)
    for message in messages:
        if message[0] in (COMMAND, TERMS) and stamp_at(message[2]) >= at_ns:
            message[2] = in_frame(message[2], second)
        elif message[0] == INPUTS and stamp_at(message[2]) >= at_ns:
            message[2] = changed(message[2], rename(second))
    words = [m for m in of(messages, EVENTS) if b"/pid" in m[2] and b"published" not in m[2]]
    for message in words[1:-1]:  # of the first process: only that it was configured
        messages.remove(message)
    activated = words[-1]
    activated[2] = event(at_ns - 1, "/pid", Event.ACTIVATED, source=second)
    at = messages.index(activated)
    parameters = next(m for m in of(messages, PARAMETERS) if b"/pid" in m[2])
    messages.insert(at, [*parameters[:2], parameters[2].replace(b"-1", b"-2"), *parameters[3:]])
    real_time.configure(messages, "pid", process=2, at=at)


@pytest.mark.parametrize("robot", [False, True])
def test_a_controller_is_judged_until_another_process_takes_its_place(robot, tmp_path):
    """The other's commands are the plant's inputs, and the rest of the run is judged to its end."""
    at_ns = 100 * H
    words = (Event.DEACTIVATED, Event.CLEANED_UP, Event.ACTIVATED)
    plan = replace(plan_of(), changes={"pid": [Change(at_ns - 1, None, word) for word in words]})
    source, path = tmp_path / "whole.mcap", tmp_path / "two.mcap"
    record_real_time(plan, source)

    def edit(messages):
        restart(messages, at_ns)
        if robot:
            messages[:] = [m for m in messages if m[0] not in (TRUTH, INPUTS)]
            messages[:] = [m for m in messages if m[0] == STATE or b"/simulator\0" not in m[2]]

    verdict = verdict_on(source, path, edit, end=False)
    assert verdict.exit_code == UNJUDGED
    line = "pid: another process acts from t = 0.5 s on, which is not judged"
    assert line in verdict.obstacles
    found = checks(verdict)
    assert (found["commands of pid"].steps, found["commands of pid"].wrong_steps) == (100, 0)
    assert all(found[name].steps == 201 for name in found if name != "commands of pid")
    run = RecordedRun.open(path)
    assert "what another process of pid sent from t = 0.5 s on" in not_judged(run)
    if robot:
        return
    terms = run.series({"pid/state": ()})["pid/state"]
    assert len(terms) == 201  # both processes' are shown
    with pytest.raises(RecordingError, match=r"another process of pid acts from t = 0\.5 s on"):
        explain(run, 0.9)
    assert explain(run, 0.4).agrees


def test_a_run_of_an_external_controller_without_inputs_is_told_of(in_time, tmp_path):
    """The plant ended before its first step: who would have acted is not known."""

    def edit(messages):
        messages[:] = [m for m in messages if m[0] != INPUTS]
        data = event(
            0, "/simulator", Event.CONNECTED, {"node": "/mine"}, source=source_of("simulator")
        )
        messages.append([EVENTS, messages[-1][1], data, messages[-1][1], 0])

    run = RecordedRun(copied(in_time, tmp_path / "a.mcap", edit, ANEW))
    assert run.external == ""
    assert verify(run.recording).exit_code == UNJUDGED


@pytest.mark.parametrize("counted", [False, True])
def test_a_killed_controller_of_another_robot_is_not_accused(counted, tmp_path):
    """What it was told may be lost with it; in a complete file one that counted is held to all it sent."""
    at_ns = 100 * H
    plan = replace(plan_of(), changes={"pid": [Change(at_ns - 1, {"gains.p": 75.0})]})
    source, path = tmp_path / "whole.mcap", tmp_path / "robot.mcap"
    record_real_time(plan, source)

    def edit(messages):
        messages[:] = [m for m in messages if m[0] not in (TRUTH, INPUTS)]
        messages[:] = [m for m in messages if m[0] == STATE or b"/simulator\0" not in m[2]]
        lost = [m for m in of(messages, EVENTS) if b"retuned" in m[2]]
        lost += [m for m in of(messages, EVENTS) if b"published" in m[2] and not counted]
        lost += [m for m in of(messages, PARAMETERS) if parse_parameter_event(m[2]).changed]
        messages[:] = [m for m in messages if m not in lost]

    verdict = verify(copied(source, path, edit, ANEW, end=counted))
    assert verdict.exit_code == (DIVERGES if counted else UNJUDGED)
    check = checks(verdict)["commands of pid"]
    assert (check.steps, check.wrong_steps > 0) == (201 if counted else 100, counted)


@pytest.mark.parametrize("sets", [2, 3])
@pytest.mark.parametrize("other", [{}, {"pulse.magnitude": 9.0}])  # it pulsed in the second's time
def test_a_disturbance_may_leave_its_first_parameters_unnamed(in_time, sets, other, tmp_path):
    """It names no source before its first state; of a process that was killed, events may be lost."""
    at_ns = 100 * H
    first, second = (real_time.source_of("disturbance", number) for number in (1, 2))

    def edit(messages):
        for message in messages:
            if message[0] == DISTURBANCE and stamp_at(message[2]) >= at_ns:
                message[2] = in_frame(message[2], second)
            elif message[0] == INPUTS and stamp_at(message[2]) >= at_ns:
                message[2] = in_frame(message[2], frame_of(message[2]).replace(first, second))
        (known,) = (m for m in of(messages, PARAMETERS) if b"/disturbance" in m[2])
        new, at = parse_parameter_event(known[2]).new, messages.index(known)
        messages[at : at + 1] = [
            [*known[:2], parameter_event(-1, "/disturbance", values, {}, KINDS), *known[3:]]
            for values in ({**new, **other}, *[new] * (sets - 1))
        ]
        real_time.configure(messages, "disturbance", process=2, at=len(messages) // 2)

    verdict = verdict_on(in_time, tmp_path / "a.mcap", edit)
    line = "disturbance: another process acts from t = 0.5 s on, which is not judged"
    assert verdict.obstacles == [line]
    check = checks(verdict)["disturbances"]
    assert (check.steps, check.wrong_steps) == (100, 0)


def test_a_gap_in_the_states_leaves_both_sides_judged(in_time, tmp_path):
    edit = without(slice(80, 90), TRUTH, STATE)
    verdict = verdict_on(in_time, tmp_path / "a.mcap", edit, end=False)
    assert verdict.exit_code == UNJUDGED
    plant = checks(verdict)["states of the plant"]
    assert (plant.steps, plant.wrong_steps, plant.unjudged) == (190, 0, 1)
    assert (plant.from_ns, plant.until_ns) == (0, 200 * H)


def test_a_late_run_is_repeated_bit_by_bit(late, tmp_path):
    run = RecordedRun.open(late)
    record_offline(run.plan(), tmp_path / "again.mcap")
    again = RecordedRun.open(tmp_path / "again.mcap")
    compared = diff(run, again)
    assert compared.identical, compared.describe()
    assert compared.compared > 1000
    assert verify(again.recording).exit_code == VERIFIED


@pytest.mark.parametrize("by_hand", [True, False])
def test_a_swap_is_judged_in_a_run_and_in_its_copy(by_hand, tmp_path):
    """Of a copy's commands none names its sender: the terms beside each tell whose it is."""
    turns = {"standby": ["lqr"]} if by_hand else {"swaps": [Swap(0.3, "lqr"), Swap(0.6, "pid")]}
    plan = plan_of(*PULSE, **turns)
    if by_hand:
        words = (Event.DEACTIVATED, Event.ACTIVATED)
        first, second = (
            [Change(k * H, None, word) for k, word in zip((59, 119), order, strict=True)]
            for order in (words, words[::-1])
        )
        plan = replace(plan, changes={"pid": first, "lqr": second})
    path, copy = tmp_path / "run.mcap", tmp_path / "copy.mcap"
    record_real_time(plan, path)
    record_offline(RecordedRun.open(path).plan(), copy)
    for recording in (path, copy):
        verdict = verify(Recording.open(recording))
        assert verdict.exit_code == VERIFIED, verdict.reasons
        steps = [checks(verdict)[f"commands of {name}"].steps for name in ("pid", "lqr")]
        assert steps == [141, 60]


@pytest.mark.parametrize("name", ["a row that is removed", "all rows"])
def test_a_run_is_not_repeated_where_what_acted_is_not_on_record(late, name, tmp_path):
    copied(late, tmp_path / "a.mcap", ROWS[name], ANEW)
    run = RecordedRun.open(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match=r"what acted at t = 0(\.3)? s is not on record"):
        run.plan()


def of_two_runs(first, second, path):
    """Write two simulators' runs with one process of pid as one recording; the first simulator was killed."""
    later = content(second).messages
    killed, begun = (real_time.source_of("simulator", k).encode() for k in (1, 2))

    def edit(messages):
        # A node that misses states is neither activated nor deactivated, as a planned one is.
        words = (b"finished", b"published", b"activated")
        messages[:] = [m for m in messages if m[0] != EVENTS or not any(w in m[2] for w in words)]
        end = 1 + max(m[1] for m in messages)
        for topic, log_time, data, publish_time, _ in later:
            if topic != EVENTS or b"\0started\0" in data or b"configured" in data:
                data = data.replace(killed, begun)
                messages.append([topic, end + log_time, data, end + publish_time, 0])
        real_time.number(messages)

    copied(first, path, edit, ANEW, end=False)
    return path


@pytest.mark.parametrize("missed", [(0, 0), (60, 90), (170, 201)])
def test_answers_to_a_second_simulator_accuse_nobody(tmp_path, missed):
    """States that pid missed in the first run share stamps with the second, whose answers accuse nobody."""
    plan, steps = plan_of(*PULSE), np.arange(201)
    there = (steps < missed[0]) | (steps >= missed[1])
    inputs = late_inputs(plan, np.where(there, 0, steps - missed[0] + 1))
    answered = replace(inputs, answered={"pid": H * steps[there]})
    record_real_time(plan, tmp_path / "first.mcap", answered)
    record_real_time(plan_of("simulator.initial.position=[0.0, 0.3]"), tmp_path / "second.mcap")
    files = [tmp_path / f"{name}.mcap" for name in ("first", "second", "both")]
    verdict = verify(Recording.open(of_two_runs(*files)))
    assert verdict.exit_code == UNJUDGED, verdict.reasons
    assert checks(verdict)["states of the plant"].steps == 201
    assert all(check.wrong_steps == 0 and check.until_ns <= 201 * H for check in verdict.checks)


def test_answers_to_a_run_that_is_not_on_record_accuse_nobody(in_time, tmp_path):
    """The recorder came late: of the first simulator, which was killed, it has nothing."""
    record_real_time(plan_of("simulator.initial.position=[0.0, 0.3]"), tmp_path / "second.mcap")
    both = of_two_runs(in_time, tmp_path / "second.mcap", tmp_path / "both.mcap")
    source = real_time.source_of("simulator").encode()

    def edit(messages):
        messages[:] = [m for m in messages if source not in m[2]]
        for process, sent in (("pid", (COMMAND, TERMS)), ("disturbance", (DISTURBANCE,))):
            published = {topic: len(of(messages, topic)) for topic in sent}
            last, name = messages[-1][1], real_time.source_of(process)
            data = event(10**9, f"/{process}", Event.PUBLISHED, published, source=name)
            messages.append([EVENTS, last, data, last, 0])
        real_time.number(messages)

    verdict = verify(copied(both, tmp_path / "late.mcap", edit, ANEW, end=False))
    assert verdict.exit_code == UNJUDGED, verdict.reasons
    assert checks(verdict)["states of the plant"].steps == 201


def test_a_process_that_gave_no_command_is_not_in_the_run(in_time, tmp_path):
    def restart(messages):
        (first, second), last = (
            (real_time.source_of("pid", k).encode() for k in (1, 2)),
            messages[-1][1],
        )
        data = next(m[2] for m in of(messages, PARAMETERS) if b"/pid" in m[2])
        messages.append([PARAMETERS, last, data.replace(first, second), last, 0])
        real_time.configure(messages, "pid", process=2, at=len(messages) - 1)

    verdict = verify(copied(in_time, tmp_path / "run.mcap", restart, ANEW))
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert checks(verdict)["commands of pid"].steps == 201


@pytest.mark.parametrize(
    ("held", "says"),
    [
        (0, "no command from pid was in force (0 of 800 steps)"),
        (500, "no command from pid was in force after t = 2.5 s (500 of 800 steps)"),
        (700, ""),  # half a second at the end: a busy machine
        (800, ""),
    ],
)
def test_a_run_in_which_nobody_controlled_says_so_first(tmp_path, held, says):
    plan = make_plan("fig6", "pid", everywhere={"duration": 4.0, "update_rate": 200.0})
    steps = np.arange(801)
    inputs = replace(late_inputs(plan), command_ns=np.where(steps < held, steps * 5_000_000, -1))
    recording = record_real_time(plan, tmp_path / "run.mcap", inputs)
    doubts = doubts_of(RecordedRun(recording), twin=False)
    assert doubts.lines[:1] == ([f"SILENT: {says}"] if says else doubts.lines[:1])
    assert doubts.silent == (says or None)
    assert (says in verify(recording).obstacles) == bool(says)
