"""Rule bases of any size: CPython, the compiled loop and lanes have the same bits; recordings verify."""

from dataclasses import replace

import numpy as np
import pytest

from trunk_core.parameters.declarations import build, values_of
from trunk_evidence.explanation import explain
from trunk_evidence.judgement import verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.conformance.kit import first_difference
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_studies.batch.block import regular_run, run_block, summary_of
from trunk_studies.batch.lanes import LANES
from trunk_views.run_report import make_report, render
from trunk_views.run_view import RunView

from ...trunk_runs.test.random_plans import Draw, rule_base

SIZES = [(2, 2), (3, 5), (5, 5), (64, 64), (9, 2)]


def plan_of(law, size, **more):
    draw = Draw(np.random.default_rng(size), 0.3)
    plan = make_plan("fig8", law, everywhere={"duration": 0.3, "update_rate": 1000.0})
    values = {**values_of(plan.controller), **rule_base(draw, law, *size), **more}
    return plan.with_controller(build(type(plan.controller), values))


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize("law", ["fuzzy_pid", "fuzzy"])
def test_compiled_code_and_lanes_have_cpythons_bits(law):
    """One compilation for all sizes: tables are arrays to compiled code."""
    form = {"fuzzy.form": "pi"} if law == "fuzzy" else {"fuzzy.consequents": "log"}
    plans = [plan_of(law, size) for size in SIZES] + [plan_of(law, (4, 6), **form)]
    assert [first_difference(plan) for plan in plans] == [None] * len(plans)
    for plan in plans:
        runs = [
            replace(plan, simulator=replace(plan.simulator, trunk_mass=0.4 + 0.01 * i))
            for i in range(LANES)
        ]
        lanes = run_block(law, [regular_run(run) for run in runs])
        assert lanes == [summary_of(run) for run in runs]


@pytest.mark.slow
@pytest.mark.parametrize(("law", "size"), [("fuzzy_pid", (3, 5)), ("fuzzy", (64, 64))])
def test_a_recording_is_verified_explained_and_reported(law, size, tmp_path):
    plan = plan_of(law, size)
    record_offline(plan, tmp_path / "run.mcap")
    run = RecordedRun.open(tmp_path / "run.mcap")
    assert verdict_on(run).word == "verified"
    explanation = explain(run, 0.2)
    assert explanation.agrees
    rule = explanation.rules[0]
    assert rule.error_label in plan.controller.axes.error
    assert rule.rate_label in plan.controller.axes.rate
    assert list(explanation.changed_tables) == [
        f"rules.{table.name}" for table in plan.controller.tables
    ]
    page = render(make_report([RunView.read(run)]))
    assert page.count('<th scope="col">r') >= size[1]
