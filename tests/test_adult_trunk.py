"""The walking adult trunk: its numbers follow from their sources, its gains from trunk tune."""

from math import pi

import pytest
from ros2_ws.src.trunk_runs.test.stepwise import steps

from trunk_runs.plan import make_plan
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.tuning.linear import linearise
from trunk_studies.tuning.methods import by_lqr, by_poles

FILES = ["profile_walking", "plant_adult_trunk", "gains_adult_trunk"]


def test_the_plant_follows_from_the_fractions():
    simulator = make_plan("fig6", "pid", FILES).simulator
    p = simulator.constants
    assert p.trunk_mass == pytest.approx(0.678 * 70.0)
    assert p.length == pytest.approx(0.626 * (0.818 - 0.530) * 1.75)
    assert p.hip_mass == pytest.approx(0.322 * 70.0)
    assert (p.amplitude, p.wavenumber) == (0.03, 2.0 * pi / 0.7)
    assert simulator.hip_mode == "prescribed"


def test_the_gains_are_those_of_tune():
    plant = linearise(make_plan("fig6", "pid", FILES).simulator)
    pid = make_plan("fig6", "pid", FILES).controller.gains
    assert pid == pytest.approx(by_poles(plant, (-12.0, -8.0, -2.0)), rel=1e-5)
    lqr = make_plan("fig6", "lqr", FILES).controller
    assert lqr.gains == pytest.approx(by_lqr(plant, 0.1, pi / 30.0, 1.0, 100.0), rel=1e-5)
    assert lqr.gravity_torque == pytest.approx(plant.a / plant.b, rel=1e-6)
    ratio = 1.0 / plant.b / 0.5
    box = make_plan("fig6", "fuzzy_pid", FILES).controller.box
    assert box == pytest.approx([ratio * v for v in (32.0, 60.0, 9.6, 18.0)], rel=1e-5)


def test_the_model_of_computed_torque_is_the_plant():
    plan = make_plan("fig6", "computed_torque", FILES)
    assert plan.controller.model == plan.simulator.constants


@pytest.mark.parametrize(
    "controller", ["pid", pytest.param("fuzzy_pid", marks=pytest.mark.one_in(8)), "lqr"]
)
def test_every_controller_walks_upright(controller):
    outcome = run_compiled(make_plan("fig6", controller, FILES)) if controller != "lqr" else None
    if outcome is None:
        plan = make_plan("fig6", controller, FILES, everywhere={"duration": 2.0})
        angle = max(abs(step.truth.position[1]) for step in steps(plan))
        assert angle < 0.1
        return
    found = outcome.metrics()
    assert found.steady_state_error_rms_deg < 1.0
    assert found.peak_torque <= 100.0
    assert max(found.theta_max_deg, -found.theta_min_deg) < 5.5


def test_computed_torque_is_hardly_affected_by_the_path():
    plan = make_plan("fig6", "computed_torque", FILES, everywhere={"duration": 2.0})
    angles = [step.truth.position[1] for step in steps(plan)]
    assert max(map(abs, angles[-500:])) < 1e-4
