"""The compiled loop gives the bits of the offline run; its metrics are those of a recording."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from trunk_experiments.analysis.metrics import metrics
from trunk_experiments.analysis.run_table import RunTable
from trunk_experiments.batch import closed_loop, compiled
from trunk_experiments.batch.check import first_difference, random_plan
from trunk_experiments.batch.closed_loop import Batch
from trunk_experiments.plans.files import PlanError
from trunk_experiments.plans.plan import make_plan
from trunk_msgs_util.recording.reader import Recording


@pytest.fixture(scope="module")
def batch():
    return Batch()


# scripts/check_compiled.py compares 1,000 of them.
def test_random_runs_have_the_same_bits(batch):
    differences = [first_difference(random_plan(index), batch) for index in range(30)]
    assert [text for text in differences if text] == []


def test_random_runs_are_of_all_kinds():
    plans = [random_plan(index) for index in range(60)]
    assert {plan.controller_name for plan in plans} == set(closed_loop.LAWS)
    assert {plan.controller.reference_profile for plan in plans} >= {"step", "sine", "sequence"}
    assert any(plan.simulator.delay_steps for plan in plans)
    assert any(plan.controller.update_rate < plan.simulator.update_rate for plan in plans)
    assert any(plan.disturbance is None for plan in plans) != all(
        plan.disturbance is None for plan in plans
    )


def test_the_comparison_sees_one_changed_bit(batch, monkeypatch):
    plan = random_plan(0)
    loop = closed_loop.compiled_loop(plan.controller_name)

    def off(setting, constants, noise, out):
        finite = loop(setting, constants, noise, out)
        out[closed_loop.THETA, 7] *= 1.0 + 2.0**-52
        return finite

    monkeypatch.setattr(closed_loop, "compiled_loop", lambda name: off)
    assert "step 7: theta is" in first_difference(plan, batch)


def test_the_same_loop_runs_in_cpython(batch):
    plan = make_plan("fig8", "pid", everywhere={"duration": 0.05})
    expected = batch.run(plan).table
    out = closed_loop.np.empty((closed_loop.ROWS, len(expected.t)))
    setting, constants = closed_loop.setting_of(plan), closed_loop.constants_of(plan)
    closed_loop.run_loop(setting, constants, closed_loop._NO_NOISE, out)
    assert out[closed_loop.THETA].tolist() == expected.theta.tolist()


@pytest.mark.parametrize("controller", ["pid", "fuzzy_pid"])
def test_metrics_are_those_of_the_recording(batch, short_run, controller):
    path = short_run("fig8", controller)
    plan = make_plan("fig8", controller, everywhere={"duration": 1.3})
    expected = metrics(RunTable.from_recording(Recording.open(path)))
    assert batch.run(plan).metrics() == expected


def test_divergence_is_told(batch):
    plan = make_plan("fig6", "pid", settings=["pid.gains.d=5000"])
    outcome = batch.run(plan)
    assert outcome.metrics() is None
    assert outcome.diverged_at == outcome.table.t[-1]
    assert 0.0 < outcome.diverged_at < 1.0


def test_an_end_and_a_compiled_law_are_needed(batch):
    plan = make_plan("fig6", "pid")
    with pytest.raises(PlanError, match="duration is 0"):
        batch.run(replace(plan, simulator=replace(plan.simulator, duration=0.0)))
    with pytest.raises(
        PlanError, match="'lpv' has no compiled loop; there are pid, fuzzy_pid, lqr"
    ):
        batch.run(replace(plan, controller_name="lpv"))


def test_a_twin_with_bindings_needs_a_name():
    with pytest.raises(ValueError, match="needs a name"):
        compiled.compiled(closed_loop.run_loop, update=closed_loop.fuzzy_pid_update)


def test_fingerprints_tell_the_laws_apart_and_stay():
    pid = compiled.fingerprint(closed_loop.run_loop, update=closed_loop.pid_update)
    fuzzy = compiled.fingerprint(closed_loop.run_loop, update=closed_loop.fuzzy_pid_update)
    assert pid != fuzzy
    assert compiled.fingerprint(closed_loop.run_loop) == pid


def test_without_a_folder_to_write_it_compiles_all_the_same(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    twin = compiled.compiled(closed_loop.saturate)
    assert twin(3.0, 2.0) == 2.0


def test_the_script_says_what_it_found():
    script = Path(__file__).parents[4] / "scripts" / "check_compiled.py"
    if not script.is_file():
        pytest.skip("not in a checkout")
    done = subprocess.run(
        [sys.executable, script, "3"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("0 differ\n")
