"""Recordings that lack what a verb needs: one line that names the file, never a traceback."""

from operator import methodcaller
from pathlib import Path

import click
import pytest
from click.exceptions import Exit
from mcap.reader import make_reader

from trunk_core import topics
from trunk_core.parameters.declarations import declarations
from trunk_core.samples import JointSample
from trunk_evidence.judgement import DIVERGES, UNJUDGED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.commands.run import command, show_run, write_run
from trunk_recording.cdr import JointStateLayout, layout_of
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.schemas import parameter_event, parse_parameter_event
from trunk_recording.writer import RecordingWriter
from trunk_runs.nodes import NODES
from trunk_runs.run_files import RunFiles

from ...trunk_recording.test.mcap_files import ANEW, copied, each
from .documents import checked
from .verbs import of_recording

pytestmark = pytest.mark.slow  # every verb, every recording

STATE = topics.controller_state("fuzzy_pid")


@pytest.fixture(scope="module")
def whole(short_run):
    return short_run("fig8", "fuzzy_pid", duration=0.3)


STOPPED = {"complete": "false", "reason": "the recorder was stopped"}


def rewritten(source, path, change, end=True):
    """Copy a run; ``change(topic, CDR, index)`` gives each message's bytes, None leaves it out."""
    copied(source, path, each(change), ANEW, end)
    return path


def kept(condition):
    """Return a change that leaves out the messages for which ``condition(topic, CDR, index)`` is false."""
    return lambda name, data, index: data if condition(name, data, index) else None


def without(*names):
    return lambda name, data, index: name not in names


def without_parameters_of(node):
    return lambda name, data, index: (
        name != topics.RUN_PARAMETERS or parse_parameter_event(data).node != f"/{node}"
    )


def without_the_last(source, path, topic, count, stopped=False):
    """Copy a run without the last messages of a topic, ``count`` of them."""
    first = Recording.open(source).topics[f"/{topic}"].count - count
    end = STOPPED if stopped else True
    return rewritten(
        source, path, kept(lambda name, data, index: name != topic or index < first), end
    )


def test_a_file_cut_between_a_command_and_its_terms_does_not_diverge(whole, tmp_path):
    for cut, expected in ((1, UNJUDGED), (2, DIVERGES)):
        path = without_the_last(whole, tmp_path / f"{cut}.mcap", STATE, cut)
        with path.open("rb") as file:
            last = make_reader(file).get_summary().chunk_indexes[-1]
        path.write_bytes(path.read_bytes()[: last.chunk_start_offset + last.chunk_length])
        assert verify(Recording.open(path)).exit_code == expected


def test_a_file_cut_before_its_first_state_is_called_damaged(whole, tmp_path, trunk):
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[:10_000])
    code, _, err = trunk("metrics", path)
    (line,) = [line for line in err.splitlines() if "error" in line]
    assert code != 0
    assert line.startswith(
        f"trunk: error: {path} is damaged, and no messages on /ground_truth/joint_states can be read: "
        "ends at byte 10000"
    )
    assert line.endswith("; record the run again")


@pytest.mark.parametrize("topic", [STATE, topics.EFFORT_COMMAND])
def test_a_recorder_that_is_stopped_between_a_command_and_its_terms_accuses_nobody(
    whole, tmp_path, topic
):
    # A command that is missing before the last terms ends what can be judged, terms do not.
    beyond = DIVERGES if topic == STATE else UNJUDGED
    for cut, expected in ((1, UNJUDGED), (2, beyond), (3, beyond)):
        path = without_the_last(whole, tmp_path / f"{cut}.mcap", topic, cut, stopped=True)
        assert verify(Recording.open(path)).exit_code == expected


def test_a_run_that_was_stopped_at_once_has_no_metrics_but_files(whole, tmp_path, capsys):
    path = rewritten(whole, tmp_path / "run.mcap", kept(without(STATE)))
    files, run = RunFiles(tmp_path), RecordedRun.open(path)
    show_run(files, run, interrupted=True)
    said = capsys.readouterr()
    assert "stopped before there was anything to measure" in said.err
    assert f"recording: {path}" in said.out
    with pytest.raises(RecordingError, match="no metrics"):
        show_run(files, run)
    assert f"recording: {path}" in capsys.readouterr().out


def test_a_run_without_metrics_has_its_document(whole, tmp_path, capsys):
    path = rewritten(whole, tmp_path / "run.mcap", kept(without(STATE)))
    told = {"scenario": "fig8", "controllers": ["fuzzy_pid"], "duration_s": 0.3}
    more = {"update_rate_hz": 1000.0, "lockstep": False, "parameters": "params.yaml"}
    with click.Context(command), pytest.raises(Exit) as end:
        write_run(RecordedRun.open(path), told | more)
    assert end.value.exit_code == RecordingError.exit_code
    said = capsys.readouterr()
    found = checked(said.out, "run-1")
    assert (found["metrics"], found["states"], found["file"]) == (None, 301, str(path))
    assert "no metrics" in found["failure"]
    assert said.err.splitlines()[-1] == f"trunk: error: {found['failure']}"


@pytest.mark.parametrize("topics_", [(STATE, topics.EFFORT_COMMAND), (topics.DISTURBANCE,)])
def test_answers_of_a_node_that_was_killed_and_started_again_accuse_nobody(
    whole, tmp_path, topics_
):
    def later(name, data, index):
        return name not in topics_ or index >= 3

    path = rewritten(whole, tmp_path / "stopped.mcap", kept(later), STOPPED)
    verdict = verify(Recording.open(path))
    assert verdict.exit_code == UNJUDGED
    assert any(
        f"{topics_[-1]}: 3 steps missing, the first at t = 0 s" in r for r in verdict.reasons
    )


@pytest.mark.parametrize("lost", [1, 2, 3])
@pytest.mark.parametrize("topics_", [(STATE, topics.EFFORT_COMMAND), (topics.DISTURBANCE,)])
def test_answers_that_a_stopped_recorder_has_missed_accuse_nobody(whole, tmp_path, topics_, lost):
    counts = {f"/{name}": Recording.open(whole).topics[f"/{name}"].count for name in topics_}

    def earlier(name, data, index):
        return name not in topics_ or index < counts[f"/{name}"] - lost

    path = rewritten(whole, tmp_path / "stopped.mcap", kept(earlier), STOPPED)
    verdict = verify(Recording.open(path))
    assert verdict.exit_code == UNJUDGED, verdict.reasons


PARTS = {
    "no ground truth": without(topics.GROUND_TRUTH),
    "no joint_states": without(topics.JOINT_STATES),
    "no commands": without(topics.EFFORT_COMMAND),
    "no disturbance": without(topics.DISTURBANCE),
    "no ~/state": without(STATE),
    "no parameters": without(topics.RUN_PARAMETERS),
    "no events": without(topics.RUN_EVENTS),
    "no parameters of the simulator": without_parameters_of("simulator"),
    "no parameters of the controller": without_parameters_of("fuzzy_pid"),
    "no parameters of the disturbance": without_parameters_of("disturbance"),
    "ground truth alone": lambda name, data, index: name == topics.GROUND_TRUTH,
    "joint_states alone": lambda name, data, index: name == topics.JOINT_STATES,
    "commands alone": lambda name, data, index: name == topics.EFFORT_COMMAND,
    "~/state alone": lambda name, data, index: name == STATE,
    "parameters alone": lambda name, data, index: name == topics.RUN_PARAMETERS,
    "the first message of each": lambda name, data, index: index == 0,
    "one state, all parameters": lambda name, data, index: (
        index == 0 or name == topics.RUN_PARAMETERS
    ),
    "empty topics": lambda name, data, index: False,
    "some states missing": lambda name, data, index: index % 7 != 3,
    "half the ~/state": lambda name, data, index: name != STATE or index > 100,
}


def edited(topic, change):
    """Return an edit that changes each sample of a topic."""

    def edit(name, data, index):
        if name != topic:
            return data
        sample = change(JointStateLayout.parse(data).unpack(data))
        return layout_of(sample).pack(sample)

    return edit


def with_parameters(node, **values):
    """Return an edit that gives a node other parameters at its start; dots are written __."""
    given = {name.replace("__", "."): value for name, value in values.items()}

    def edit(name, data, index):
        if name != topics.RUN_PARAMETERS:
            return data
        event = parse_parameter_event(data)
        if event.node != f"/{node}" or not event.new:
            return data
        kinds = {name: d.kind for name, d in declarations(NODES[node].config).items()}
        return parameter_event(event.stamp_ns, event.node, {**event.new, **given}, {}, kinds)

    return edit


def first_joint(sample):
    return JointSample(sample.stamp_ns, sample.name[:1], *(values[:1] for values in sample[2:]))


NONE = {"position": (), "velocity": (), "effort": ()}
REPLACED = {
    "joint_states without velocity": (topics.JOINT_STATES, {"velocity": ()}),
    "joint_states without effort": (topics.JOINT_STATES, {"effort": ()}),
    "joint_states of other joints": (topics.JOINT_STATES, {"name": ("elbow", "wrist")}),
    "ground truth without velocity": (topics.GROUND_TRUTH, {"velocity": ()}),
    "ground truth without effort": (topics.GROUND_TRUTH, {"effort": ()}),
    "ground truth without values": (topics.GROUND_TRUTH, NONE),
    "commands without effort": (topics.EFFORT_COMMAND, NONE | {"position": (1.0,)}),
    "commands to another joint": (topics.EFFORT_COMMAND, {"name": ("wrist",)}),
    "commands to two joints": (
        topics.EFFORT_COMMAND,
        {"name": ("hip", "trunk"), "effort": (0.0, 1.0)},
    ),
    "disturbances without offsets": (topics.DISTURBANCE, {"position": ()}),
    "~/state of other names": (STATE, NONE | {"name": ("a", "b"), "position": (1.0, 2.0)}),
    "~/state without values": (STATE, NONE),
}
EDITS = {
    **{
        name: edited(topic, methodcaller("_replace", **values))
        for name, (topic, values) in REPLACED.items()
    },
    "joint_states of one joint": edited(topics.JOINT_STATES, first_joint),
    "ground truth of one joint": edited(topics.GROUND_TRUTH, first_joint),
    "disturbances of one joint": edited(topics.DISTURBANCE, first_joint),
    "parameters out of bounds": with_parameters("simulator", plant__hip_mass=-1.0),
    "parameters of another version": with_parameters("simulator", plant__colour=3.0),
    "a controller of another joint": with_parameters("fuzzy_pid", joint="wrist"),
    "a simulator of other joints": with_parameters("simulator", joints=("elbow", "wrist")),
}


def of_another_robot(path, topic):
    """Write another robot arm's states on one of our topics."""
    with RecordingWriter(path) as writer:
        channel = writer.channel(topic, topics.JOINT_STATE_TYPE)
        for k in range(50):
            sample = JointSample(k * 10_000_000, ("shoulder", "elbow", "wrist"), (0.1, 0.2, 0.3))
            writer.write(channel, k, k, layout_of(sample).pack(sample))
    return path


def without_channels(path):
    with RecordingWriter(path):
        pass
    return path


FOREIGN = {
    "another robot's joint_states": lambda path: of_another_robot(path, "/joint_states"),
    "another robot's ground truth": lambda path: of_another_robot(path, f"/{topics.GROUND_TRUTH}"),
    "another robot's commands": lambda path: of_another_robot(path, "/effort_command"),
    "another robot's ~/state": lambda path: of_another_robot(path, f"/{STATE}"),
    "no topics at all": without_channels,
}


def partial(name, whole, path):
    if name in FOREIGN:
        return FOREIGN[name](path)
    return rewritten(whole, path, EDITS[name] if name in EDITS else kept(PARTS[name]))


VERBS = [*of_recording(Path(), Path(), Path())]


@pytest.mark.one_in(20)
@pytest.mark.filterwarnings("error")  # they would be shown to the user
@pytest.mark.parametrize("part", [*PARTS, *EDITS, *FOREIGN])
@pytest.mark.parametrize("verb", VERBS)
def test_one_line_at_most(part, verb, whole, tmp_path, trunk):
    path = partial(part, whole, tmp_path / "part.mcap")
    words = of_recording(path, whole, tmp_path)[verb]
    code, out, err = trunk(*words)
    # The first of all to need a law's compiled code says so.
    beside = ("trunk: warning: ", "trunk: compiling ")
    errors = [line for line in err.splitlines() if not line.startswith(beside)]
    assert code in (0, 1, 2)
    assert len(errors) <= 1
    for line in errors:
        assert line.startswith("trunk: error: ")
        assert str(path) in line
    if code:
        assert errors or out  # it says what is wrong
