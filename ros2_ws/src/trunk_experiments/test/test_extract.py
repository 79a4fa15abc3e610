import csv
from math import inf

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from trunk_control.laws import law_named
from trunk_core.errors import PlanError
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable, all_columns, column_units
from trunk_experiments.commands.export import (
    window,
    write_csv,
    write_mcap,
    write_npz,
    write_parquet,
)
from trunk_recording.reader import Recording, RecordingError
from trunk_views.animation import write_gif, write_mp4

TRUTH = "/ground_truth/joint_states"


@pytest.fixture(scope="module")
def run(short_run):
    return RecordedRun.open(short_run("fig8", "fuzzy_pid"))


@pytest.fixture(scope="module")
def table(run):
    return all_columns(run, RunTable.from_run(run))


def test_tables_hold_the_same_bits(table, tmp_path):
    part = window(table, 0.2, 0.9)
    assert (part["t"][0], part["t"][-1], len(part["t"])) == (0.2, 0.9, 701)
    write_parquet(part, tmp_path / "a")
    write_npz(part, tmp_path / "b")
    write_csv(part, tmp_path / "c")
    parquet, npz = pq.read_table(tmp_path / "a"), np.load(tmp_path / "b")
    with (tmp_path / "c").open() as file:
        rows = list(csv.DictReader(file))
    assert list(parquet.column_names) == list(npz) == list(rows[0]) == list(part)
    assert ",".join(part) == (
        "t,x,theta,x_dot,theta_dot,theta_measured,reference,torque,kp,ki,kd,alpha,"
        "error,error_rate,p_term,i_term,d_term,unsaturated,command,"
        "disturbance_hip_effort,disturbance_trunk_effort,disturbance_hip_position,disturbance_trunk_position"
    )
    for name, column in part.items():
        expected = column.tobytes()
        assert parquet[name].to_numpy().tobytes() == expected
        assert npz[name].tobytes() == expected
        assert np.array([float(row[name]) for row in rows]).tobytes() == expected
    assert len(window(table)["t"]) == 1301


def test_tables_may_have_units(run, table, tmp_path):
    units = column_units(run)
    units = {name: units[name] for name in table}
    write_csv(table, tmp_path / "a.csv", units)
    with (tmp_path / "a.csv").open() as file:
        names = next(csv.reader(file))
    assert names[:3] == ["t [s]", "x [m]", "theta [rad]"]
    assert {"kp [N m/rad]", "alpha", "p_term [N m]", "disturbance_trunk_position [rad]"} <= set(
        names
    )
    write_parquet(table, tmp_path / "a.parquet", units)
    schema = pq.read_schema(tmp_path / "a.parquet")
    assert {f.name: f.metadata[b"unit"].decode() for f in schema} == units
    pandas = pytest.importorskip("pandas")
    assert pandas.read_parquet(tmp_path / "a.parquet").attrs["units"] == units


def test_a_law_s_own_terms_have_its_units(short_run):
    units = column_units(RecordedRun(Recording.open(short_run("fig8", "computed_torque"))))
    own = law_named("computed_torque").units
    assert own
    assert own.items() <= units.items()


def test_export_writes_units_where_they_are_asked_for(trunk, run, tmp_path):
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    trunk("export", run.path, "-o", first)
    trunk("export", run.path, "-o", second, "--units")
    assert first.read_text().startswith("t,x,theta,")
    assert second.read_text().startswith("t [s],x [m],theta [rad],")
    assert first.read_text().split("\n")[1:] == second.read_text().split("\n")[1:]


def test_terms_and_disturbance_belong_to_their_states(table):
    """By what defines them: u = P + I + D, and a pulse of 100 degrees from 1 s to 1.1 s."""
    summed = table["p_term"] + table["i_term"] + table["d_term"]
    np.testing.assert_allclose(summed, table["unsaturated"], rtol=1e-12)
    np.testing.assert_array_equal(table["command"], table["torque"])
    pulse = (table["t"] >= 1.0) & (table["t"] < 1.1)
    expected = np.where(pulse, np.radians(100.0), 0.0)
    np.testing.assert_array_equal(table["disturbance_trunk_position"], expected)
    assert not np.any(table["disturbance_hip_effort"])


def test_an_animation_has_25_pictures_a_second(run, table, tmp_path):
    parameters = run.parameters["simulator"]
    assert write_gif(table, parameters, tmp_path / "a.gif") == 33  # 0 to 1.28 s
    with Image.open(tmp_path / "a.gif") as film:
        assert (film.size, film.n_frames, film.info["duration"]) == ((640, 400), 33, 40)
        first = np.asarray(film.convert("L"), dtype=int)
        film.seek(26)  # t = 1.04 s, in the pulse
        assert np.abs(np.asarray(film.convert("L"), dtype=int) - first).max() > 100
    with pytest.raises(PlanError, match="at most 120 s apart"):
        write_gif({**table, "t": 1e3 * table["t"]}, parameters, tmp_path / "b.gif")


@pytest.mark.parametrize("code", [0, 1])
def test_a_film_is_what_the_machines_ffmpeg_makes_of_the_pictures(
    run, table, tmp_path, monkeypatch, code
):
    encoder = tmp_path / "ffmpeg"  # keeps what it is given
    encoder.write_text(f'#!/bin/sh\nfor file; do :; done; cat >"$file"; exit {code}\n')
    parameters = run.parameters["simulator"]
    monkeypatch.setenv("PATH", "")
    with pytest.raises(PlanError, match=r"apt install ffmpeg, or write a \.gif"):
        write_mp4(table, parameters, tmp_path / "a.mp4")
    encoder.chmod(0o700)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    if code:
        with pytest.raises(PlanError, match="ffmpeg failed with 1"):
            write_mp4(table, parameters, tmp_path / "a.mp4")
        assert not (tmp_path / "a.mp4").exists()
        return
    assert write_mp4(table, parameters, tmp_path / "a.mp4") == 33
    assert (tmp_path / "a.mp4").stat().st_size == 33 * 640 * 400 * 3


def test_a_part_is_copied_byte_for_byte(run, tmp_path):
    path = tmp_path / "part.mcap"
    count = write_mcap(run, path, 0.5, 0.6, ["joint_states", "/run/parameters", "/run/events"])
    part = Recording.open(path)
    ((log, data),) = part.messages("/joint_states")
    blocks = run.recording.messages("/joint_states")
    whole = {t: m for block in blocks for t, m in zip(*block, strict=True)}
    assert log == [k * 1_000_000 for k in range(500, 601)]
    assert data == [whole[t] for t in log]
    assert count == 101 + len(run.first_sets)
    assert RecordedRun(part).first_sets == run.first_sets  # set before, and still holding
    assert part.provenance == run.recording.provenance
    assert part.events("/run/events") == []
    assert not part.complete
    assert "t = 0.5 to 0.6 s" in part.end["reason"]


@pytest.mark.parametrize(
    ("start", "end", "topics", "said"),
    [
        (-inf, 1.0, (), ", up to t = 1 s, 8 topics"),
        (0.5, inf, (), ", from t = 0.5 s, 8 topics"),
        (-inf, inf, ("joint_states",), ", 1 topics"),
    ],
)
def test_an_open_end_is_not_mentioned(run, tmp_path, start, end, topics, said):
    write_mcap(run, tmp_path / "part.mcap", start, end, topics)
    reason = Recording.open(tmp_path / "part.mcap").end["reason"]
    assert reason == f"exported from {run.path.name}{said}"


def test_the_whole_run_is_copied_complete_and_unchanged(run, tmp_path):
    path = tmp_path / "all.mcap"
    assert write_mcap(run, path) == sum(topic.count for topic in run.recording.topics.values())
    copy = Recording.open(path)
    assert copy.complete
    assert copy.joints(TRUTH).position.tobytes() == run.joints(TRUTH).position.tobytes()


def test_an_unknown_topic_is_named(run, tmp_path):
    with pytest.raises(RecordingError, match="has no topic /states, only "):
        write_mcap(run, tmp_path / "a.mcap", topics=["states"])
    assert not (tmp_path / "a.mcap").exists()
