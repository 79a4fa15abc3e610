"""Recordings that lack what a verb needs: one line that names the file, never a traceback."""

import click
import pytest
from click.exceptions import Exit
from mcap.reader import make_reader

from trunk_core import topics
from trunk_evidence.judgement import DIVERGES, UNJUDGED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.commands.run import command, show_run, write_run
from trunk_recording.reader import Recording, RecordingError
from trunk_runs.run_files import RunFiles

from ...trunk_recording.test.mcap_files import ANEW, copied, each
from .documents import checked

pytestmark = pytest.mark.slow

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
