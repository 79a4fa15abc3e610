"""Falls, incomplete files and late steps come first, in words and in JSON; such a run is never the best."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from trunk_core.errors import RecordingError
from trunk_core.results import values
from trunk_evidence.doubts import Doubts, doubts_of
from trunk_evidence.recorded_run import Late, RecordedRun, late_steps
from trunk_recording.writer import RECORD, RecordingWriter, metadata_yaml
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_views.comparison import best_of

LATE = "LATE: the machine was too busy, 1 of 1300 steps late"
ADVICE = ": --lockstep gives the exact run"


def test_an_exact_run_has_no_late_steps(short_run):
    run = RecordedRun.open(short_run("fig6", "pid"))
    assert late_steps(run) is None
    assert not doubts_of(run)
    assert doubts_of(run).lines == []


def fallen(path):
    settings = ["simulator.fall.angle=0.4", "pid.gains.d=0.5"]
    plan = make_plan("fig8", "pid", settings=settings)
    record_offline(replace(plan, simulator=replace(plan.simulator, duration=1.3)), path)
    return path


@pytest.mark.slow
def test_a_fall_comes_first(tmp_path, trunk):
    path = fallen(tmp_path / "fallen.mcap")
    assert doubts_of(RecordedRun.open(path)).fell == 0.0
    for verb in ("metrics", "info"):
        code, out, _ = trunk(verb, path)
        assert (code, out.splitlines()[0]) == (0, "FELL: at t = 0 s, 30 degrees")
        values = json.loads(trunk(verb, "--json", path)[1])
        assert values["doubts"]["fell"] == 0.0
    told_of = trunk("plot", path, "-o", tmp_path / "a.png")[2]
    assert "FELL: at t = 0 s" in told_of


def test_only_sound_runs_can_be_best():
    assert best_of([1.0, 2.0, 3.0]) == (0,)
    assert best_of([1.0, 2.0, 2.0], [False, True, True]) == (1, 2)
    assert best_of([1.0, None], [False, True]) == ()


def test_words_and_values():
    found = Doubts(False, "the disk is full", 0.5, 10.0, 1.06, -93.2, late=Late(35, 10_000, 140.2))
    moved = "in lock-step the angle differs by up to 140 degrees"
    assert found.lines == [
        "INCOMPLETE: the disk is full; ends at 0.5 of 10 s",
        "FELL: at t = 1.06 s, -93 degrees",
        f"LATE: the machine was too busy, 35 of 10000 steps late; {moved}{ADVICE}",
    ]
    assert values(replace(found, judged="diverges")) == {
        "complete": False,
        "reason": "the disk is full",
        "ends_at_s": 0.5,
        "planned_s": 10.0,
        "fell": 1.06,
        "fell_angle_deg": -93.2,
        "beyond_90": None,
        "silent": None,
        "unsound": [],
        "refused": [],
        "late": {"steps": 35, "of": 10_000, "moved_deg": 140.2},
        "not_judged": [],
        "judged": "diverges",
    }
    assert values(Doubts()) == {
        "complete": True,
        "reason": None,
        "ends_at_s": None,
        "planned_s": None,
        "fell": None,
        "fell_angle_deg": None,
        "beyond_90": None,
        "silent": None,
        "unsound": [],
        "refused": [],
        "late": None,
        "not_judged": [],
        "judged": None,
    }
    in_time = {"steps": 0, "of": 500, "moved_deg": 0.0}
    assert values(Doubts(late=Late(0, 500, 0.0)))["late"] == in_time


def cut(source: Path, path: Path) -> Path:
    """Copy a run of 1.3 s as far as a recorder killed after 0.625 s had written it."""
    writer = RecordingWriter(path)
    with source.open("rb") as file:
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if message.log_time > 625_000_000:
                break
            if channel.topic not in channels:
                channels[channel.topic] = writer.channel(channel.topic, schema.name)
            writer.write(
                channels[channel.topic], message.log_time, message.publish_time, message.data
            )
        writer.flush()
        written = path.stat().st_size
        writer.finish(complete=False, reason="")
    path.write_bytes(path.read_bytes()[:written])
    return path


SAID = "the recorder did not finish this file; ends at 0.625 of 1.3 s"


@pytest.mark.parametrize("verb", ["metrics", "info"])
def test_an_incomplete_run_is_said_to_be_so_first_and_once(short_run, tmp_path, trunk, verb):
    path = cut(short_run("fig6", "pid"), tmp_path / "cut.mcap")
    code, out, err = trunk(verb, path)
    assert code == 0
    assert out.splitlines()[0] == f"INCOMPLETE: {SAID}"
    assert SAID not in err
    assert "did not shut down properly" not in err + out
    doubts = json.loads(trunk(verb, "--json", path)[1])["doubts"]
    assert (doubts["complete"], doubts["ends_at_s"], doubts["planned_s"]) == (False, 0.625, 1.3)


def test_metrics_of_an_incomplete_run_are_marked(short_run, tmp_path, trunk):
    path = cut(short_run("fig6", "pid"), tmp_path / "cut.mcap")
    assert "angle, INCOMPLETE" in " ".join(trunk("metrics", path)[1].split())
    assert "INCOMPLETE" not in trunk("metrics", short_run("fig6", "pid"))[1]


@pytest.mark.slow
def test_plots_and_comparisons_say_it_once_too(short_run, tmp_path, trunk):
    path, whole = cut(short_run("fig6", "pid"), tmp_path / "cut.mcap"), short_run("fig6", "lqr")
    _, out, err = trunk("plot", path, "-o", tmp_path / "a.png")
    assert [line for line in err.splitlines() if "INCOMPLETE" in line or "order" in line] == [
        f"trunk: warning: {path}: INCOMPLETE: {SAID}"
    ]
    _, out, err = trunk("compare", path, whole)
    assert out.splitlines()[0] == f"cut: INCOMPLETE: {SAID}"
    assert "INCOMPLETE" not in "".join(out.splitlines()[1:])
    assert "did not shut down properly" not in err


@pytest.mark.parametrize("verb", ["diff", "explain", "export", "verify"])
def test_verbs_without_metrics_say_it_first_and_once(short_run, tmp_path, trunk, verb):
    path = cut(short_run("fig6", "pid"), tmp_path / "cut.mcap")
    words = {"diff": [path], "explain": ["--at", 0.3], "export": ["-o", tmp_path / "a.csv"]}
    _, out, err = trunk(verb, path, *words.get(verb, []))
    if verb == "verify":
        first = out.splitlines()[1]
        assert first == "  obstacle: no trunk_end record: the recorder did not shut down properly"
        assert "did not finish" not in out
        return
    whose = f"{path}: " if verb == "diff" else ""
    assert err.splitlines()[0] == f"trunk: warning: {whose}INCOMPLETE: {SAID}"
    assert err.count(SAID) == (2 if verb == "diff" else 1)  # both runs are this one
    assert "did not shut down properly" not in err


def test_a_bag_that_lacks_messages_is_incomplete_for_that_reason(short_run, tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "run.mcap").write_bytes(short_run("fig6", "pid").read_bytes())
    record = dict(RecordedRun.open(folder / "run.mcap").recording.opened[0].metadata_records)
    text = metadata_yaml(record[RECORD], "run.mcap")
    count = next(line for line in text.splitlines() if line.strip().startswith("message_count"))
    (folder / "metadata.yaml").write_text(text.replace(count, "  message_count: 7"))
    assert doubts_of(RecordedRun.open(folder)).lines == [
        "INCOMPLETE: the number of messages is not the one in metadata.yaml; ends at 1.3 of 1.3 s"
    ]


@pytest.mark.parametrize("count", ["abc", "-1", "1.5", "true", "[1]"])
def test_a_number_of_messages_that_is_none_is_named(short_run, tmp_path, count):
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "run.mcap").write_bytes(short_run("fig6", "pid").read_bytes())
    record = dict(RecordedRun.open(folder / "run.mcap").recording.opened[0].metadata_records)
    lines = metadata_yaml(record[RECORD], "run.mcap").splitlines()
    place = next(i for i, line in enumerate(lines) if line.strip().startswith("message_count"))
    lines[place] = f"  message_count: {count}"
    (folder / "metadata.yaml").write_text("\n".join(lines))
    with pytest.raises(
        RecordingError, match=r"message_count is .*: repair it with ros2 bag reindex"
    ):
        RecordedRun.open(folder)
