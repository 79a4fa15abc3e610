"""Searches on a study's draws: what a fall costs, reproducible, and judged on other draws."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_core.errors import StudyError
from trunk_experiments.cli import trunk
from trunk_studies.learning import learn
from trunk_studies.rows import make_bases, plan_of, rows_of
from trunk_studies.statistics import DrawnRuns
from trunk_studies.study import design, parse_study
from trunk_studies.sweep_execution import RunBlock, run_block
from trunk_studies.tuning.search import cost, metrics_of

from .documents import checked

STUDY = """
scenario: fig8
params: profile_practical
rate: 200
duration: 1.5
controllers: {rules: {node: fuzzy_pid}, pid: {}}
runs: 6
seed: 7
set: {simulator.substeps: 1, simulator.fall.angle: 60deg}
vary:
  speed: {parameter: "simulator.initial.velocity[0]", distribution: uniform, low: -9.0, high: 9.0}
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.3, high: 0.8}
"""


@pytest.fixture(scope="module")
def study():
    return parse_study(STUDY, "study.yaml")


def outcome(study, label, values, metric):
    """Return a contender's metric in each of a study's draws, with some parameters changed."""
    bases = make_bases(study)
    rows = rows_of(design(study, 0, study.total))
    plans = [plan_of(study, bases, row) for row in rows if row["controller"] == label]
    return metrics_of(plans, metric, [values])[0]


def test_outcomes_are_those_of_a_sweep(study):
    bases = make_bases(study)
    table = run_block(RunBlock(0, study, bases, design(study, 0, study.total), ""))
    fallen = np.array(table["fell"])
    expected = np.where(fallen, np.nan, table["iae"].to_numpy())
    labels = np.array(table["controller"].to_pylist())
    for label in ("rules", "pid"):
        assert np.array_equal(
            outcome(study, label, {}, "iae"), expected[labels == label], equal_nan=True
        )
    assert 0 < fallen.sum() < len(fallen)


def test_a_fall_counts_and_a_changed_parameter_acts(study):
    metric = outcome(study, "rules", {}, "iae")
    stood = metric[~np.isnan(metric)]
    falls = len(metric) - len(stood)
    assert 0 < falls < len(metric)
    assert cost(metric, 50.0) == pytest.approx((stood.sum() + 50.0 * falls) / len(metric))
    assert DrawnRuns("rules", metric).fell == falls
    assert not np.array_equal(outcome(study, "rules", {"gains.p_max": 90.0}, "iae"), metric)


def test_a_search_is_reproducible_and_judged_on_other_draws(study):
    words = study, "rules", "iae", 2, 4, 3, 99, 1
    heard = []
    first = learn(*words, lambda *progress: heard.append(progress))
    assert learn(*words, lambda *_: None).values == first.values
    assert heard[-1] == (2, first.after)
    assert first.after < first.before
    assert first.after == cost(outcome(study, "rules", first.values, "iae"), first.fall_costs)
    others = replace(study, seed=99)
    assert [o.controller for o in first.held_out] == ["rules", "rules, learned", "pid"]
    for held_out, values in zip(first.held_out, ({}, first.values, {}), strict=True):
        label = held_out.controller.partition(",")[0]
        assert np.array_equal(
            held_out.metric, outcome(others, label, values, "iae"), equal_nan=True
        )
    assert not np.array_equal(first.held_out[0].metric, first.searched[0].metric, equal_nan=True)


@pytest.mark.parametrize(
    ("controller", "seed", "says"),
    [("lqr", 8, "no controller 'lqr' in it: it has rules, pid"), ("rules", 7, "must be others")],
)
def test_what_cannot_be_judged_is_refused(study, controller, seed, says):
    with pytest.raises(StudyError, match=says):
        learn(study, controller, "iae", 1, 1, 1, seed, 1, lambda *_: None)


@pytest.mark.slow
def test_the_verb_says_what_it_found_on_other_draws(tmp_path):
    """In worker processes."""
    file, output = tmp_path / "study.yaml", tmp_path / "learned.yaml"
    file.write_text(STUDY)
    words = ["tune", "optimise", "--study", str(file), "--controller", "pid", "--generations", "1"]
    words += ["--jobs", "2"]
    done = CliRunner().invoke(trunk, [*words, "--population", "4", "-o", str(output), "--json"])
    assert done.exit_code == 0, done.exception
    document = checked(done.stdout, "tune-1")
    held_out = document["study"]["held_out"]
    assert document["study"]["held_out_seed"] == 8
    assert [o["controller"] for o in held_out] == ["pid", "pid, learned", "rules"]
    assert all(o["share"]["low"] <= o["fell"] / 6 <= o["share"]["high"] for o in held_out)
    assert output.exists()
    done = CliRunner().invoke(trunk, [*words, "--set", "pid.gains.p=1"])
    assert "leave out --set" in str(done.exception)
