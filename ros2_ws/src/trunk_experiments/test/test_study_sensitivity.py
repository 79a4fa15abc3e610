"""Sobol indices: known ones are found; falls are counted; a study without any is refused in one line."""

import pyarrow as pa
import pytest

from trunk_core.errors import StudyError
from trunk_studies.sensitivity import check_sensitivity, sensitivities, total_runs
from trunk_studies.statistics import FELL
from trunk_studies.study import parse_study
from trunk_studies.sweep_results import METRICS

STUDY = """
scenario: fig6
controllers: [pid, fuzzy_pid]
block: 100
vary:
  a: {parameter: simulator.plant.length, distribution: uniform, low: 1.0, high: 2.0}
  b: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 1.0, high: 2.0}
  c: {parameter: simulator.plant.hip_mass, distribution: uniform, low: 1.0, high: 2.0}
"""


def runner_of(metric, fell=lambda row: False, status=lambda row: "ok"):
    """Return a runner that computes a metric from a row instead of running it."""

    def run(blocks):
        for block in reversed(list(blocks)):  # as processes may end in any order
            names = list(block.columns)
            rows = [
                dict(zip(names, one, strict=True))
                for one in zip(*block.columns.values(), strict=True)
            ]
            table = {
                "run": [row["run"] for row in rows],
                "controller": [row["controller"] for row in rows],
                "status": [status(row) for row in rows],
                "reason": ["too long"] * len(rows),
                **{name: [metric(row) for row in rows] for name in METRICS},
                "fell": [fell(row) for row in rows],
            }
            yield block.index, pa.table(table)

    return run


def found(runner, n=128, metrics=("iae",)):
    done = []
    some = sensitivities(
        parse_study(STUDY, "s.yaml"), {}, n, metrics, runner, lambda *told: done.append(told)
    )
    assert done[-1] == (total_runs(parse_study(STUDY, "s.yaml"), n),) * 2
    return {(one.controller, one.metric): one for one in some}


def test_the_smallest_angle_keeps_its_sign():
    some = found(runner_of(lambda row: row["a"] + row["b"] - 3.0), metrics=("theta_min_deg",))
    first = {i.name: i.first.value for i in some["pid", "theta_min_deg"].parameters}
    assert (first["a"], first["b"]) == pytest.approx((0.5, 0.5), abs=0.1)


def test_indices_of_a_sum_and_a_product_are_found():
    def metric(row):
        if row["controller"] == "pid":
            return 3.0 * row["a"] + row["b"]  # variances 9 : 1, c does nothing
        return (row["a"] - 1.5) * (row["b"] - 1.5) + 5.0  # none alone, both together

    some = found(runner_of(metric))
    told = {i.name: i for i in some["pid", "iae"].parameters}
    assert [i.name for i in some["pid", "iae"].parameters] == ["a", "b", "c"]
    for name, share in (("a", 0.9), ("b", 0.1), ("c", 0.0)):
        for estimate in (told[name].first, told[name].total):
            assert estimate.value == pytest.approx(share, abs=0.05)
            assert estimate.low - 1e-9 <= share <= estimate.high + 1e-9
    product = {i.name: i for i in some["fuzzy_pid", "iae"].parameters}
    for name, total in (("a", 1.0), ("b", 1.0), ("c", 0.0)):
        assert product[name].first.value == pytest.approx(0.0, abs=0.2)
        assert product[name].total.value == pytest.approx(total, abs=0.2)
    assert some["pid", FELL].parameters == ()  # nobody fell
    assert not some["pid", "iae"].doubtful
    assert found(runner_of(metric), n=8) == found(runner_of(metric), n=8)  # seeded


def test_runs_that_fell_are_counted_and_are_the_worst():
    def fell(row):
        return row["b"] > 1.75

    some = found(runner_of(lambda row: row["a"], fell), n=64)
    falls, iae = some["pid", FELL], some["pid", "iae"]
    assert falls.filled == 0
    assert falls.fell == iae.filled == iae.fell > 0.2 * iae.runs
    assert iae.doubtful
    assert falls.parameters[0].name == "b"
    assert falls.parameters[0].total.value == pytest.approx(1.0, abs=0.1)
    assert next(i for i in iae.parameters if i.name == "b").total.value > 0.1


def test_a_refused_run_ends_it_in_one_line():
    runner = runner_of(lambda row: 1.0, status=lambda row: "refused")
    with pytest.raises(StudyError, match="do not fit together: too long: narrow the distributions"):
        found(runner, n=4)


@pytest.mark.parametrize(
    "word", [("--force",), ("--check",), ("-o", "a.parquet"), ("--scheduler", "tcp://a:1")]
)
def test_what_it_has_no_use_for_is_refused(trunk, tmp_path, word):
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    line = f"--sobol writes no file and goes on no cluster: leave out {word[0]}"
    assert trunk("sweep", study, "--sobol", 2, *word) == (2, "", f"trunk: error: {line}\n")


@pytest.mark.parametrize(
    ("old", "new", "n", "metric", "line"),
    [
        ("", "", 100, "iae", "--sobol is 100: a power of two from 2 is needed, such as 64 or 128"),
        ("", "", 1, "iae", "--sobol is 1: a power of two"),
        ("", "", 8, "nix", "no metric 'nix': one of overshoot_deg"),
        (
            "distribution: uniform, low: 1.0, high: 2.0",
            "values: [1.0]",
            8,
            "iae",
            "two or more drawn entries are needed, not 0",
        ),
        ("distribution: uniform", "from: 1.0, to: 2.0, steps: 3", 8, "iae", "a grid of 3 values"),
    ],
)
def test_mistakes(old, new, n, metric, line):
    text = STUDY.replace(old, new) if old else STUDY
    if "steps" in new:
        text = text.replace("steps: 3, low: 1.0, high: 2.0", "steps: 3")
    with pytest.raises(StudyError) as caught:
        check_sensitivity(parse_study(text, "s.yaml"), n, (metric,))
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)
