"""`trunk verify` catches what is changed in a copy of a recording; `trunk diff` says where."""

import struct
import tracemalloc
from dataclasses import replace

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, NONE, copied

from trunk_evidence.differences import diff
from trunk_evidence.explanation import explain
from trunk_evidence.judgement import DIVERGES, UNJUDGED, VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.digests import HEADS, PARTS
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.schemas import parameter_event, parse_parameter_event
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.timeline import Change

from .messages import COMMAND, DISTURBANCE, STATE, TRUTH, of

PARAMETERS = "/run/parameters"


def flip_last_bit(message):
    data = bytearray(message[2])
    data[-8] ^= 1  # the lowest bit of the last double
    message[2] = bytes(data)


def swap(messages, topic, k):
    """Swap message k and the next one in the file."""
    a, b = of(messages, topic)[k : k + 2]
    a[1:], b[1:] = b[1:], a[1:]


def change_parameter(messages, node, change):
    for message in of(messages, PARAMETERS):
        event = parse_parameter_event(message[2])
        if event.node == node:
            new = dict(event.new)
            change(new)
            kinds = {name: "double array" for name, value in new.items() if value == ()}
            message[2] = parameter_event(event.stamp_ns, node, new, {}, kinds)


def other_label(row, column):
    """Change a rule table's cell of Kp."""

    def change(values):
        table = [labels.split() for labels in values["rules.kp"]]
        table[row][column] = "S" if table[row][column] == "B" else "B"
        values["rules.kp"] = tuple(" ".join(labels) for labels in table)

    return change


def test_a_whole_run_is_verified(whole):
    verdict = verify(Recording.open(whole))
    assert verdict.exit_code == VERIFIED
    assert {part.name: part.steps for part in verdict.checks} == {
        "commands of fuzzy_pid": 1201,
        "measured states": 1201,
        "states of the plant": 1201,
        "disturbances": 1202,
    }


def test_an_untouched_copy_is_verified_and_identical(whole, tmp_path):
    copy = copied(whole, tmp_path / "copy.mcap")
    assert verify(copy).exit_code == VERIFIED
    found = diff(RecordedRun.open(whole), RecordedRun(copy))
    assert found.identical
    assert found.compared == 1201 * 4 + 1202
    assert not found.parameters
    assert not found.provenance


EDITS = {
    "one bit of one command": lambda m: flip_last_bit(of(m, COMMAND)[700]),
    "one bit of one measured state": lambda m: flip_last_bit(of(m, STATE)[300]),
    "one bit of one true state": lambda m: flip_last_bit(of(m, TRUTH)[300]),
    "one bit of one disturbance": lambda m: flip_last_bit(of(m, DISTURBANCE)[300]),
    "the plant's length": lambda m: change_parameter(
        m, "/simulator", lambda v: v.update({"plant.length": 1.0000000000000002})
    ),
    "a gain range": lambda m: change_parameter(
        m, "/fuzzy_pid", lambda v: v.update({"gains.p_max": 60.00000000000001})
    ),
    "the noise's seed": lambda m: change_parameter(
        m, "/simulator", lambda v: v.update({"sensor.seed": 2})
    ),
    "a pulse's magnitude": lambda m: change_parameter(
        m, DISTURBANCE, lambda v: v.update({"pulse.magnitude": 1.7})
    ),
    "a rule that was used": lambda m: change_parameter(m, "/fuzzy_pid", other_label(3, 3)),
}


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS.keys())
def test_a_change_diverges_by_recomputation_alone(whole, tmp_path, edit):
    verdict = verify(copied(whole, tmp_path / "changed.mcap", edit, digests=NONE))
    assert verdict.exit_code == DIVERGES
    assert not verdict.altered


@pytest.mark.slow
def test_one_bit_of_one_command_is_found_at_its_step_one_ulp_apart(whole, tmp_path):
    copy = copied(whole, tmp_path / "changed.mcap", EDITS["one bit of one command"], digests=NONE)
    commands = next(p for p in verify(copy).checks if p.name == "commands of fuzzy_pid")
    assert commands.wrong_steps == 1
    assert commands.first[0].stamp_ns == 700_000_000
    found = diff(RecordedRun.open(whole), RecordedRun(copy))
    assert (found.differing_steps, found.first.topic) == (1, "effort_command")
    assert found.first.stamp_ns == 700_000_000
    assert found.first.field == "effort[trunk]"
    assert ", 1 ULP apart" in found.first.describe()


def test_a_plant_that_diverges_when_computed_is_said_to(whole, tmp_path):
    def edit(messages):
        change_parameter(messages, "/simulator", lambda new: new.update({"plant.length": 1e-9}))

    verdict = verify(copied(whole, tmp_path / "changed.mcap", edit, digests=NONE))
    assert verdict.reasons[-1].endswith("computed the plant diverges in this step")


@pytest.mark.slow
def test_a_change_without_effect_on_any_bit_is_caught_by_the_digests(whole, tmp_path):
    unused = {"i_clamp_max": 1e9}
    copy = copied(
        whole,
        tmp_path / "changed.mcap",
        lambda m: change_parameter(m, "/fuzzy_pid", lambda v: v.update(unused)),
    )
    verdict = verify(copy)
    assert verdict.exit_code == DIVERGES
    assert verdict.altered == [PARAMETERS]


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize("topic", [COMMAND, STATE, TRUTH, DISTURBANCE])
@pytest.mark.parametrize(
    ("edit", "word"),
    [
        (lambda m, topic: m.remove(of(m, topic)[500]), "missing"),
        (lambda m, topic: swap(m, topic, 500), "go backwards"),
        (lambda m, topic: m.append(list(of(m, topic)[-1])), "appears twice"),
    ],
    ids=["dropped", "swapped", "doubled"],
)
def test_a_message_dropped_swapped_or_doubled_is_never_verified(whole, tmp_path, topic, edit, word):
    copy = copied(whole, tmp_path / "changed.mcap", lambda m: edit(m, topic), digests=NONE)
    verdict = verify(copy)
    assert verdict.exit_code != VERIFIED
    assert any(topic[1:] in line and word in line for line in verdict.obstacles)
    assert verify(
        copied(whole, tmp_path / "with_digests.mcap", lambda m: edit(m, topic))
    ).altered == sorted([topic, PARTS[HEADS]])


@pytest.mark.one_in(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "topic",
    [
        TRUTH,
        STATE,
        *(pytest.param(topic, marks=pytest.mark.one_in(8)) for topic in (COMMAND, DISTURBANCE)),
    ],
)
def test_one_stamp_in_the_far_future_costs_no_more_than_any_other(whole, tmp_path, topic):
    def edit(messages):
        message = of(messages, topic)[700]
        message[2] = message[2][:4] + struct.pack("<iI", 2**31 - 1, 0) + message[2][12:]

    copy = copied(whole, tmp_path / "future.mcap", edit, digests=NONE)
    tracemalloc.start()
    verdict = verify(copy)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert verdict.exit_code != VERIFIED
    assert peak < 64 << 20


@pytest.mark.slow
def test_a_run_without_an_end_marker_cannot_be_judged(whole, tmp_path):
    verdict = verify(copied(whole, tmp_path / "endless.mcap", end=False, digests=NONE))
    assert verdict.exit_code == UNJUDGED
    assert verdict.obstacles[0] == "no trunk_end record: the recorder did not shut down properly"


def test_a_run_without_parameters_cannot_be_judged(whole, tmp_path):
    def edit(messages):
        messages[:] = [m for m in messages if m[0] != PARAMETERS]

    verdict = verify(copied(whole, tmp_path / "bare.mcap", edit, digests=NONE))
    assert verdict.exit_code == UNJUDGED
    assert any("no parameters recorded of" in line for line in verdict.obstacles)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arithmetic", "line"),
    [("", "no provenance that names its arithmetic"), ("portable-2", "in arithmetic 'portable-2'")],
)
def test_another_arithmetic_is_not_recomputed(whole, tmp_path, arithmetic, line):
    copy = copied(whole, tmp_path / "other.mcap", provenance={"arithmetic": arithmetic})
    verdict = verify(copy)
    assert verdict.exit_code != VERIFIED
    assert not verdict.checks
    assert any(line in obstacle for obstacle in verdict.obstacles)
    with pytest.raises(RecordingError, match=line):
        RecordedRun(copy).plan()
    found = explain(RecordedRun(copy), 0.5)  # everything else reads it
    assert (found.agrees, found.rounded_otherwise) == (True, False)


@pytest.mark.parametrize(("change", "excused"), [(1e-15, True), (10.0, False)])
def test_another_arithmetic_excuses_only_rounding(whole, tmp_path, change, excused):
    def edit(messages):
        message = of(messages, COMMAND)[500]
        (value,) = struct.unpack("<d", message[2][-8:])
        message[2] = message[2][:-8] + struct.pack("<d", value * (1.0 + change))

    told = {"arithmetic": ""}
    copy = copied(whole, tmp_path / "other.mcap", edit, ANEW, provenance=told)
    found = explain(RecordedRun(copy), 0.5)
    assert (found.agrees, found.rounded_otherwise) == (False, excused)


def test_a_reference_by_topic_is_followed_while_the_profile_asks_for_it(tmp_path):
    plan = make_plan("fig6", "pid", everywhere={"duration": 0.3, "update_rate": 200.0})
    told = {"reference.profile": "topic"}
    let_go = {"reference.profile": "constant"}
    plan = replace(
        plan,
        changes={"pid": [Change(50_000_000, told), Change(200_000_000, let_go)]},
        references={k * 5_000_000: 0.25 for k in range(61)},
    )
    path = tmp_path / "run.mcap"
    record_offline(plan, path)
    recording = Recording.open(path)
    references = RecordedRun(recording).table("pid/state").values("position")[:, 0].tolist()
    assert references == [0.0] * 11 + [0.25] * 30 + [0.0] * 20
    assert verify(recording).exit_code == VERIFIED


def test_runs_of_different_controllers_differ(whole, tmp_path):
    other = tmp_path / "pid.mcap"
    plan = make_plan("fig8", "pid")
    plan = replace(plan, simulator=replace(plan.simulator, duration=0.1))
    record_offline(plan, other)
    found = diff(RecordedRun.open(whole), RecordedRun.open(other))
    assert found.first.stamp_ns == 0
    assert "fuzzy_pid: only in A" in found.parameters


def test_what_no_joint_state_shows_is_in_the_diff_too(whole, tmp_path):
    """Order across topics, log times, an event: data are identical, the record is not."""

    def edit(messages):
        messages.insert(0, messages.pop(messages.index(of(messages, COMMAND)[700])))
        of(messages, STATE)[5][1] += 1
        event = of(messages, "/run/events")[-1]
        event[2] = event[2].replace(b"1201", b"1202")

    copy = copied(whole, tmp_path / "edited.mcap", edit)
    found = diff(RecordedRun.open(whole), RecordedRun(copy))
    assert not any("log times" in line and "of A" in line for line in found.record)
    assert any("order" in line and "of B" in line for line in found.record)
    assert any(line.startswith("joint_states: logged at") for line in found.record)
    assert any(line.startswith("events of simulator: finished") for line in found.record)
