"""The baselines as whole runs: recorded, verified from the record, and as good as theory predicts."""

import pytest

from trunk_core.errors import PlanError
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable, metrics
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan


def recorded(path, scenario, controller, params=(), settings=(), duration=3.0):
    plan = make_plan(scenario, controller, params, settings, {"duration": duration})
    record_offline(plan, path)
    return Recording.open(path)


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("controller", ["lqr", "computed_torque"])
@pytest.mark.parametrize("profile", ["profile_paper", "profile_practical"])
def test_a_recorded_run_verifies(controller, profile, tmp_path):
    verdict = verify(recorded(tmp_path / "run.mcap", "fig9", controller, [profile]))
    assert verdict.exit_code == VERIFIED, verdict
    assert [part.steps for part in verdict.checks] == [3001, 3001, 3001, 3002]


def test_computed_torque_with_an_exact_model_obeys_its_error_equation(tmp_path):
    # Both poles at -10 1/s: theta = theta_0 (1 + 10 t) exp(-10 t), whatever the hip does.
    recording = recorded(
        tmp_path / "run.mcap", "fig6", "computed_torque", ["profile_practical"], duration=1.0
    )
    table = RunTable.from_run(RecordedRun(recording))
    t = table.t
    expected = table.theta[0] * (1.0 + 10.0 * t) * 2.718281828459045 ** (-10.0 * t)
    assert table.theta == pytest.approx(expected, abs=5e-3)  # held over a period of 1 ms


@pytest.mark.slow
def test_the_feed_forward_holds_a_lean_without_an_integral(tmp_path):
    settings = ["lqr.gains.i=0.0", "simulator.hip.mode=prescribed"]
    settings += ["simulator.path.amplitude=0.0", "simulator.initial.velocity=[0.0, 0.0]"]
    recording = recorded(
        tmp_path / "run.mcap", "fig7", "lqr", ["profile_practical"], settings, duration=8.0
    )
    found = metrics(RunTable.from_run(RecordedRun(recording)))
    assert abs(found.steady_state_error_mean_deg) < 1e-3


def test_a_missing_hip_joint_is_reported():
    with pytest.raises(
        PlanError, match="'pelvis' is not one of the simulator's joints: hip, trunk"
    ):
        make_plan("fig6", "computed_torque", settings=["computed_torque.hip_joint=pelvis"])


def test_the_bound_of_the_sampled_loop_includes_the_models_inertia():
    plan = make_plan("fig6", "computed_torque", settings=["computed_torque.gains.d=1500"])
    assert "kd = 750" in plan.warnings[0]


def test_a_controller_of_another_joint_is_refused():
    with pytest.raises(
        PlanError, match="pid: joint 'hip' is not the second of the simulator's joints: hip, trunk"
    ):
        make_plan("fig6", "pid", settings=["pid.joint=hip"])
