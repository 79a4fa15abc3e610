"""One step of the plant: where the trunk falls, and where the numbers end."""

from math import inf, isfinite, nextafter

import pytest

from trunk_core.mechanics import Body
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.plants.trunk import passive, prescribed
from trunk_sim.step import PlantConstants, PlantStatus, act, at_rest, on_second

QUIET = Disturbance()
LEANING = PlantState(0.0, 0.5, 0.0, 0.0)
PLANT = PlantConstants(Body(), 0.005, 1, inf, inf)


def mirrored(state: PlantState, sign: float) -> PlantState:
    return state._replace(theta=sign * state.theta)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["forward", "backward"])
def test_at_rest_it_has_fallen_beyond_the_angle_and_not_at_it(sign):
    trunk = at_rest(mirrored(LEANING, sign), PLANT._replace(fall_angle=0.5))
    assert trunk == PlantStatus(mirrored(LEANING, sign), 0.0, False, False)
    assert at_rest(mirrored(LEANING, sign), PLANT._replace(fall_angle=0.499)).fallen


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["forward", "backward"])
def test_a_step_beyond_the_angle_is_a_fall_and_one_up_to_it_is_not(sign):
    before = PlantStatus(mirrored(LEANING, sign), 0.0, False, False)
    reached = abs(act(before, 0.0, QUIET, PLANT, on_second, passive).state.theta)
    assert not act(
        before, 0.0, QUIET, PLANT._replace(fall_angle=reached), on_second, passive
    ).fallen
    assert act(
        before, 0.0, QUIET, PLANT._replace(fall_angle=nextafter(reached, 0.0)), on_second, passive
    ).fallen


def test_a_fallen_trunk_stays_fallen():
    fallen = PlantStatus(PlantState(0.0, 0.0, 0.0, 0.0), 0.0, True, False)
    assert act(fallen, 0.0, QUIET, PLANT, on_second, passive).fallen


@pytest.mark.parametrize("fallen", [True, False])
def test_one_number_that_is_not_finite_is_divergence(fallen):
    # b = torque / (m l^2) = 1e308: 6 b overflows in the rate's mean, b h nowhere in the angle's.
    body = Body(gravity=0.0, amplitude=0.0)
    before = PlantStatus(PlantState(0.0, 0.0, 1.0, 0.0), 7.0, fallen, False)
    after = act(before, 5e307, QUIET, PLANT._replace(constants=body), on_second, prescribed)
    assert after == before._replace(diverged=True)
    assert isfinite(
        act(
            before, 1e307, QUIET, PLANT._replace(constants=body), on_second, prescribed
        ).state.theta_dot
    )


def test_the_applied_effort_is_reported_without_the_disturbance():
    after = act(
        at_rest(LEANING, PLANT), 9.0, Disturbance(0.0, 4.0, 0.0, 0.0), PLANT, on_second, passive
    )
    assert after.effort == 9.0
    assert not after.diverged
