"""The library returns what the command does, refuses in one line, and its results cannot be changed."""

import copy
import gc
import json
import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from click.testing import CliRunner

import trunk_experiments.api as trunk
from trunk_experiments.commands import export, metrics
from trunk_recording.writer import RecordingWriter
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

LISTED = {"trunk_mass": trunk.grid("simulator.plant.trunk_mass", np.array([0.4, 0.6]))}


@pytest.fixture(scope="module")
def run():
    return trunk.simulate(trunk.plan("fig8", "pid", duration=1.3))


@pytest.fixture(scope="module")
def swept():
    vary = {
        "mass": trunk.draw("simulator.plant.trunk_mass", "uniform", low=0.3, high=0.8),
        "speed": trunk.grid("simulator.initial.velocity[0]", [0.5, 1.0]),
    }
    return trunk.sweep(trunk.study("fig8", ["pid", "fuzzy_pid"], vary, duration=2.5, runs=3))


def test_importing_it_loads_nothing_large_and_no_ros():
    large = ["numba", "pyarrow", "matplotlib", "scipy", "pandas", "rclpy", "click"]
    code = f"import sys, trunk_experiments.api; print([n for n in {large} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_a_simulated_run_is_the_recording_that_the_command_makes(run, tmp_path):
    plan = make_plan("fig8", "pid", everywhere={"duration": 1.3})
    record_offline(plan, tmp_path / "run.mcap")
    told = CliRunner().invoke(metrics.command, [str(tmp_path / "run.mcap"), "--json"])
    values = json.loads(told.stdout)["metrics"]
    numbers = {name: value if value is None else float(value) for name, value in values.items()}
    assert numbers == trunk.metrics(run).as_dict()  # one that is infinite is text in JSON
    loaded = trunk.load(tmp_path / "run.mcap")
    for same in (loaded, trunk.simulate(run.plan())):
        for name, column in same.arrays().items():
            assert column.tobytes() == run.arrays()[name].tobytes(), name
    CliRunner().invoke(export.command, [str(loaded.path), "-o", str(tmp_path / "run.npz")])
    archive = np.load(tmp_path / "run.npz")
    assert set(archive) == set(loaded.arrays())
    assert all(archive[n].tobytes() == c.tobytes() for n, c in loaded.arrays().items())


def test_every_column_has_a_unit_and_is_an_attribute(run):
    columns = run.arrays()
    assert [name for name in columns if name not in trunk.UNITS] == []
    own = {**run.terms, **run.disturbance}
    assert {"p_term", "i_term", "d_term", "disturbance_trunk_effort"} <= own.keys()
    assert all(own.get(name, getattr(run, name, None)) is c for name, c in columns.items())
    assert not any(column.flags.writeable for column in own.values())
    assert {len(column) for column in columns.values()} == {len(run)} == {1301}
    assert set(trunk.metrics(run).as_dict()) <= set(trunk.UNITS)


@pytest.mark.slow
def test_explanations_branches_and_reports_are_those_of_the_commands(run, tmp_path):
    why = trunk.explain(run, at=1.06)
    assert why.agrees
    assert why.terms.p_term == run.terms["p_term"][run.t == why.update_s]
    other = trunk.branch(run, 0.5, overrides={"pid.gains.p": 70.0}, output=tmp_path / "b.mcap")
    assert other.theta[:501].tobytes() == run.theta[:501].tobytes()
    assert set(other.kp[501:]) == {70.0}
    assert trunk.verify(other).verified
    wrong = {"pid.update_rate": 100.0, "pid.gains.p": {}, "lqr.gains.p": 1.0}
    for name, value in wrong.items():
        with pytest.raises(trunk.TrunkError, match=rf"^overrides: .?{name[:3]}") as caught:
            trunk.branch(run, 0.5, overrides={name: value})
        assert "--" not in str(caught.value)
    trunk.report(run, other, output=tmp_path / "page.html")
    with pytest.raises(trunk.PlanError, match="it exists"):
        trunk.report(run, output=tmp_path / "page.html")


def test_tuned_gains_are_overrides_of_a_plan():
    gains = trunk.tune("pid", poles=[-12.0, -8.0, -2.0])
    plan = trunk.plan("demo", "pid", overrides=gains)
    assert plan.parameters["pid"]["gains.p"] == gains["pid.gains.p"] == pytest.approx(72.905)
    softer = trunk.tune("lqr", largest={"torque": 1.0})
    assert softer["lqr.gains.i"] < trunk.tune("lqr")["lqr.gains.i"]
    sampled = trunk.tune("lqr", rate=100.0, discrete=True)
    ratios = [sampled[f"lqr.gains.{n}"] / trunk.tune("lqr")[f"lqr.gains.{n}"] for n in "pid"]
    assert ratios == pytest.approx([0.92, 0.92, 0.92], abs=0.03)  # smaller, as docs/model.md says
    with pytest.raises(trunk.PlanError, match="one of lqr, state_feedback, pid, computed_torque"):
        trunk.tune("fuzzy_pid")
    with pytest.raises(trunk.PlanError, match="above 0, of integral, angle, speed, torque"):
        trunk.tune("lqr", largest={"force": 1.0})
    with pytest.raises(trunk.PlanError, match="above 0, of position, angle, velocity, speed"):
        trunk.tune("state_feedback", largest={"integral": 1.0})
    with pytest.raises(trunk.PlanError, match="cannot move one without the other"):
        trunk.tune("state_feedback", largest={"position": 0.1})


def test_a_relay_gives_table_1s_gains():
    relay = trunk.relay(0.02, 0.5)
    assert (relay.gain, relay.exact_gain) == pytest.approx(
        (22.2997, 25.4), rel=2e-3
    )  # docs/paper.md
    plan = trunk.plan("demo", "pid", overrides=relay.overrides)
    assert plan.parameters["pid"]["gains.p"] == pytest.approx(0.6 * relay.gain)
    assert relay.overrides["pid.gains.d"] / (0.6 * relay.gain) == pytest.approx(relay.period / 8.0)
    with pytest.raises(trunk.PlanError, match=r"no ultimate gain: .* damping > 0\.0981 \(SI\)"):
        trunk.relay(0.02, 0.05)


@pytest.mark.slow
def test_a_search_finds_what_a_simulation_confirms():
    of = [("fig6", "pid"), ("fig7", "pid")]
    plans = [trunk.plan(*p, duration=2.0, rate=200.0) for p in of]
    heard = []
    optimum = trunk.optimise(
        *plans, metric="iae", generations=1, population=2, progress=lambda *best: heard.append(best)
    )
    assert optimum.after < optimum.before
    assert heard == [(1, optimum.after)]
    for overrides, mean in (({}, optimum.before), (optimum.overrides, optimum.after)):
        again = [trunk.plan(*p, duration=2.0, rate=200.0, overrides=overrides) for p in of]
        iae = [trunk.metrics(trunk.simulate(plan)).iae for plan in again]
        assert np.mean(iae) == pytest.approx(mean, rel=1e-9)


@pytest.mark.slow
def test_what_was_learned_is_judged_on_other_draws():
    speed = trunk.draw("simulator.initial.velocity[0]", "uniform", low=-2.0, high=2.0)
    study = trunk.study("fig6", ["pid", "lqr"], {"speed": speed}, duration=1.0, rate=200.0, runs=3)
    learned = trunk.learn(study, "pid", metric="iae", generations=1, population=2)
    assert learned.after <= learned.before
    assert [drawn.controller for drawn in learned.held_out] == ["pid", "pid, learned", "lqr"]
    assert all((drawn.fell, drawn.runs) == (0, 3) for drawn in learned.held_out)
    assert learned.held_out[0].mean != learned.searched[0].mean
    assert set(learned.overrides) <= {f"pid.gains.{name}" for name in "pid"}


@pytest.mark.slow
def test_a_limit_is_where_the_run_falls():
    found = trunk.limit("demo", "disturbance.pulse.magnitude", 0.0, 5.0, "pid", within=0.05)
    assert found.falls - found.stands <= 0.25
    for value, falls in ((found.stands, False), (found.falls, True)):
        made = trunk.plan("demo", "pid", overrides={"disturbance.pulse.magnitude": value})
        assert (trunk.simulate(made).fell_at is not None) == falls


def test_overrides_win_over_files_and_accept_numpy_values():
    table = ["B B B B B B B"] * 7
    plan = trunk.plan(
        "fig8",
        params=["fuzzy_zhao_1993", "profile_practical"],
        overrides={
            "fuzzy_pid.rules.kd": table,
            "simulator.initial.position": np.array([0.0, 0.1]),
            "simulator.sensor.seed": np.int64(7),
            "simulator.max_effort": np.float64(np.inf),
        },
        rate=np.float64(500.0),
    )
    told = plan.parameters
    assert told["fuzzy_pid"]["rules.kd"] == tuple(table)
    assert told["simulator"]["initial.position"] == (0.0, 0.1)
    assert (told["simulator"]["sensor.seed"], told["simulator"]["max_effort"]) == (7, np.inf)
    assert plan.rate == told["fuzzy_pid"]["update_rate"] == 500.0


def test_a_plan_takes_the_pushes_of_the_command():
    planned = trunk.plan("demo", "pid", duration=0.3, pushes=["60Nm:0.1s@0.1"])
    acting = trunk.simulate(planned).disturbance["disturbance_trunk_effort"]
    assert acting.tolist() == [60.0 if 20 <= k < 40 else 0.0 for k in range(61)]  # at 200 Hz
    with pytest.raises(trunk.TrunkError, match="'60Nm': "):
        trunk.plan("demo", pushes=["60Nm"])


def test_controllers_take_turns():
    plan = trunk.plan("fig6", "pid", swaps=[(0.5, "fuzzy_pid")], duration=1.0)
    run = trunk.simulate(plan)
    assert plan.controllers == run.controllers == ("pid", "fuzzy_pid")
    assert np.ptp(run.alpha[:500]) == 0.0 < np.ptp(run.alpha[500:])


def test_a_temporary_recording_is_deleted_with_its_run(tmp_path):
    short = trunk.simulate(trunk.plan("fig6", duration=0.1))
    path = short.path
    short.save(tmp_path / "kept.mcap")
    assert path.read_bytes() == (tmp_path / "kept.mcap").read_bytes()
    del short
    gc.collect()
    assert not path.parent.exists()


def test_a_run_is_passed_to_another_process_by_its_path(run, tmp_path):
    plan = trunk.plan("fig6", duration=0.1)
    kept = trunk.simulate(plan, output=tmp_path / "kept.mcap")
    passed = pickle.loads(pickle.dumps(kept))
    assert passed.path == kept.path
    assert passed.theta.tobytes() == kept.theta.tobytes()
    temporary = trunk.simulate(plan)
    with pytest.raises(
        trunk.PlanError, match=r"^fig6_fuzzy_pid.mcap: a temporary file.*save it and load"
    ):
        pickle.dumps(temporary)
    assert copy.deepcopy(temporary) is copy.copy(temporary) is temporary


def test_a_run_that_diverges_raises_and_leaves_its_recording_so_far(tmp_path):
    plan = trunk.plan("fig6", "pid", overrides={"pid.gains.d": 1e9}, duration=1.0)
    assert "unstable" in repr(plan)
    with pytest.raises(trunk.DivergedError):
        trunk.simulate(plan, output=tmp_path / "run.mcap")
    assert trunk.load(tmp_path / "run.mcap").doubts[0].startswith("INCOMPLETE")


@pytest.mark.slow
def test_results_cannot_be_changed(run, swept):
    with pytest.raises(ValueError, match="read-only"):
        run.theta[0] = 1.0
    with pytest.raises(TypeError):
        run.parameters["pid"]["gains.p"] = 1.0
    for one in (run, trunk.metrics(run), trunk.verify(run), swept, run.plan()):
        with pytest.raises(FrozenInstanceError):
            one.anything = 1


def test_a_verdict_counts_the_steps(run):
    found = trunk.verify(run)
    assert (found.verified, found.verdict, found.reasons) == (True, "verified", [])
    assert found.steps == sum(one.steps_checked for one in found.parts) > 2600


def test_a_picture_is_shown_and_written(run, tmp_path):
    picture = trunk.plot(run, run, fig=8, names=["one", "other"])
    data, told = picture._repr_png_()
    assert data.startswith(b"\x89PNG")
    assert told == {"width": 768}
    picture.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == data
    texts = {text.get_text() for text in picture.figure.legends[0].get_texts()}
    assert {"one", "other"} <= texts
    overview = trunk.plot(run, names=["mine"]).figure
    assert "mine" in {text.get_text() for text in overview.legends[0].get_texts()}


def test_a_row_of_a_sweep_is_the_run_that_simulate_makes(swept):
    row = {name: column[7] for name, column in swept.arrays().items()}
    overrides = {
        "simulator.plant.trunk_mass": row["mass"],
        "simulator.initial.velocity": [row["speed"], 0.0],
    }
    plan = trunk.plan("fig8", row["controller"], overrides=overrides, duration=2.5)
    single = trunk.metrics(trunk.simulate(plan)).as_dict()
    exactly = {n: np.nan if v in (None, np.inf) else v for n, v in single.items()}
    assert {name: row[name] for name in single} == pytest.approx(exactly, 0.0, 0.0, nan_ok=True)


def test_a_sweep_can_be_kept_and_loaded(swept, tmp_path):
    assert len(swept) == 12
    swept.save(tmp_path / "a.parquet")
    loaded = trunk.load_sweep(tmp_path / "a.parquet")
    assert loaded.columns == swept.columns
    for name in swept.columns:
        np.testing.assert_array_equal(loaded[name], swept[name])
    assert loaded["controller"].tolist() == ["pid", "fuzzy_pid"] * 6
    assert loaded["run"].dtype == np.int64
    assert (loaded.of("pid")["iae"] == swept["iae"][::2]).all()


def test_a_sweep_to_a_file_equals_one_of_the_studys_text(tmp_path):
    study = trunk.study("fig6", ["pid"], LISTED, duration=0.5)
    (tmp_path / "study.yaml").write_text(study.text)
    told = []
    trunk.sweep(study, output=tmp_path / "a.parquet", progress=lambda *done: told.append(done))
    trunk.sweep(trunk.read_study(tmp_path / "study.yaml"), output=tmp_path / "b.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert told == [(2, 2)]


def test_controllers_are_compared_over_the_same_draws(swept):
    (fell, iae) = swept.compare(["iae"])
    assert (fell.metric, iae.metric, iae.first, iae.second) == ("fallen", "iae", "pid", "fuzzy_pid")
    assert iae.low <= iae.mean <= iae.high or iae.verdict == "too few pairs"


def test_two_grids_make_a_map():
    vary = {**LISTED, "speed": trunk.grid("simulator.initial.velocity[0]", [0.5, 1.0])}
    swept = trunk.sweep(trunk.study("fig6", ["pid"], vary, duration=0.5))
    panel = swept.map("trunk_mass", "speed").figure.axes[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("trunk_mass (kg)", "speed (m/s)")


def test_frames_have_units(run, swept):
    pandas = pytest.importorskip("pandas")
    frame = run.frame()
    assert isinstance(frame, pandas.DataFrame)
    assert (frame.index.name, frame.attrs["units"]["torque"]) == ("t", "N m")
    assert frame["theta"].to_numpy().tobytes() == run.theta.tobytes()
    assert swept.frame().loc[7, "controller"] == "fuzzy_pid"


def test_without_pandas_one_line_says_how_to_install_it(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(trunk.LibraryError, match=r"pip install -r requirements/notebook\.txt"):
        run.frame()


def test_text_in_a_recording_is_not_markup(hostile_run):
    path, words = hostile_run
    run = trunk.load(path)
    assert run.scenario in words
    for shown in (run._repr_html_(), trunk.verify(run)._repr_html_()):
        assert "<script" not in shown
        assert "<img" not in shown


def test_a_recording_without_states_can_still_be_shown(tmp_path):
    with RecordingWriter(tmp_path / "empty.mcap") as writer:
        writer.finish(complete=True, reason="finished")
    run = trunk.load(tmp_path / "empty.mcap")
    assert "ground_truth" in run._repr_html_()
    with pytest.raises(trunk.RecordingError, match="ground_truth"):
        run.arrays()


UNGUARDED = """
import trunk_experiments.api as trunk

try:
    trunk.sweep(trunk.read_study("study.yaml"), jobs=2)
except trunk.SweepError as error:
    print(error)
"""


@pytest.mark.slow
def test_a_script_without_a_guard_gets_an_explanation(tmp_path):
    text = trunk.study("fig6", ["pid"], LISTED, duration=0.1).text
    (tmp_path / "study.yaml").write_text(f"{text}block: 1\n")
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert 'if __name__ == "__main__":' in done.stdout
    assert done.stdout.count("\n") == 1


def test_names_are_listed_with_a_line_about_each():
    assert trunk.scenarios()["fig8"].startswith("The paper's Fig. 8")
    assert trunk.controllers()["fuzzy_pid"] == "Fuzzy-PID"
    assert "pid_as_printed" in trunk.parameter_files()
    assert "robustness" in trunk.studies()
    mass = trunk.parameters("simulator")["plant.trunk_mass"]
    assert (mass.default, mass.unit, mass.fixed) == (0.5, "kg", False)
    assert "> 0" in mass.allowed
