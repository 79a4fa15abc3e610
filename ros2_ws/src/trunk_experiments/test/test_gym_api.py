"""What Gymnasium asks of an environment and of a vector environment, and which options are refused."""

import importlib
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

import trunk_experiments.gym
from trunk_core.errors import NotInstalledError, PlanError
from trunk_core.parameters.declarations import ParameterError
from trunk_experiments.gym import ENVIRONMENT
from trunk_experiments.gym.episodes import MOST_BYTES

OPTIONS = {
    "torque": {},
    "gains": {"action": "gains"},
    "some gains": {"action": "gains", "largest_gains": (100.0, 50.0, 20.0)},
    "scenario": {"scenario": "fig8"},
    "files": {"params": ["profile_walking", "plant_adult_trunk"]},
    "values": {"settings": ["simulator.sensor.position_noise=0.01", "disturbance.noise.rms=1"]},
    "rate": {"rate": 500.0, "duration": 2.0},
    "nothing drawn": {"spread": (0.0, 0.0, 0.0, 0.0)},
    "no cost of torque": {"effort_weight": 0.0},
}
# Angles have no natural bound, and torques are in N m.
ABOUT_BOUNDS = "A Box .* space (minimum|maximum) value is|For Box action spaces, we recommend"


@pytest.mark.one_in(2)
@pytest.mark.slow
@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_gymnasiums_own_check_passes(options):
    env = gymnasium.make(ENVIRONMENT, **options).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=f"(?s).*({ABOUT_BOUNDS})")
        check_env(env)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(
    "options", [{}, {"action": "gains", "largest_gains": (5, 5, 1)}], ids=["torque", "gains"]
)
def test_the_vector_environment_equals_gymnasiums_own_around_single_ones(mode, options):
    """The oracle is `SyncVectorEnv`: observations, rewards, ends and infos, over several episodes."""
    short = {"duration": 0.25, "settings": ["simulator.fall.angle=0.65"], **options}
    ours = gymnasium.make_vec(ENVIRONMENT, 5, "vector_entry_point", autoreset_mode=mode, **short)
    theirs = gymnasium.make_vec(
        ENVIRONMENT, 5, "sync", vector_kwargs={"autoreset_mode": AutoresetMode(mode)}, **short
    )
    assert ours.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert ours.single_action_space == theirs.single_action_space
    assert ours.observation_space == theirs.observation_space
    assert same(ours.reset(seed=3), theirs.reset(seed=3))
    ours.action_space.seed(1)
    fell = lasted = 0
    for k in range(160):
        actions = ours.action_space.sample() * (0.3 if k % 3 else 1.0)
        got = ours.step(actions)
        assert same(got, theirs.step(actions)), k
        fell, lasted = fell + got[2].sum(), lasted + got[3].sum()
    assert fell
    assert lasted


def same(a, b):
    """Return True for the same bits; arrays of numbers may be of another type (int, np.int64)."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if a.dtype == object:
        return data_equivalence(list(a), list(b), exact=True)
    return bool(np.array_equal(a, b))


def test_disabled_autoreset_leaves_resets_to_the_caller():
    envs = gymnasium.make_vec(
        ENVIRONMENT, 3, "vector_entry_point", autoreset_mode="Disabled", duration=0.05
    )
    envs.reset(seed=[7, 8, 9])
    envs.step(envs.action_space.sample())
    mask = np.array([False, True, False])
    seen, infos = envs.reset(options={"reset_mask": mask}, seed=[1, 8, 1])
    assert infos["step"].tolist() == [1, 0, 1]
    assert infos["_step"].tolist() == mask.tolist()
    alone = gymnasium.make(ENVIRONMENT, duration=0.05).unwrapped
    assert np.array_equal(seen[1], alone.reset(seed=8)[0])
    for _ in range(9):
        *_, truncated, _ = envs.step(envs.action_space.sample())
    assert truncated.tolist() == [True, False, True]
    with pytest.raises(ResetNeeded, match="the episode of environment 0 has ended"):
        envs.step(envs.action_space.sample())


def test_returned_arrays_do_not_change_in_later_steps():
    envs = gymnasium.make_vec(ENVIRONMENT, 3, "vector_entry_point")
    seen, infos = envs.reset(seed=1)
    kept = seen.copy(), infos["angle"].copy()
    first = envs.step(np.full((3, 1), 3.0))
    copies = [one.copy() for one in first[:4]]
    envs.step(np.full((3, 1), -3.0))
    assert same((seen, infos["angle"]), kept)
    assert same(tuple(first[:4]), tuple(copies))


WRONG = {
    "scenario": ({"scenario": "fig5"}, "no scenario 'fig5': give one of"),
    "action": ({"action": "torqe"}, r"action 'torqe': give one of torque, gains.*torque"),
    "gains": ({"largest_gains": (1, 2, 3)}, "largest_gains: it is for action='gains' only"),
    "two gains": ({"action": "gains", "largest_gains": (1, 2)}, r"largest_gains \(1, 2\): give 3"),
    "spread": ({"spread": (0, -1, 0, 0)}, r"spread \(0, -1, 0, 0\): give 4 finite numbers, 0 or"),
    "fallen": (
        {"spread": (0, 1.5, 0, 0)},
        r"the initial angle is up to 2\.0\d* rad, beyond fall\.angle",
    ),
    "far": ({"spread": (1e7, 0, 0, 0)}, r"parameter 'initial\.position': .* is not allowed"),
    "weight": ({"effort_weight": "much"}, r"effort_weight \['much'\]: give a finite number"),
    "text": ({"settings": "pid.gains.p=1"}, r"settings 'pid\.gains\.p=1': give a list"),
    "law": ({"settings": ["lqr.gains.p=1"]}, r"^settings lqr\.gains\.p=1: no node of this run"),
    "value": ({"settings": ["pid.gains.p={"]}, r"^settings 'pid\.gains\.p={': the value cannot"),
    "endless": ({"duration": 0.0}, "duration is 0"),
    "long": ({"duration": 1e5}, "an episode has at most 200000 states"),
    "topic": ({"settings": ["pid.reference.profile=topic"]}, "nobody publishes references"),
    "render": ({"render_mode": "human"}, "rendering is not supported"),
}


@pytest.mark.parametrize(("options", "says"), WRONG.values(), ids=WRONG)
def test_options_that_make_no_environment_are_refused_in_one_line(options, says):
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises((PlanError, ParameterError), match=says) as caught:
            make(ENVIRONMENT, **options)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"num_envs": 0}, "num_envs 0: give 1 or more"),
        (
            {"autoreset_mode": "Next"},
            "autoreset_mode 'Next': give one of NextStep, SameStep, Disabled",
        ),
        (
            {
                "num_envs": MOST_BYTES // 2001 // 16 + 1,
                "settings": ["simulator.sensor.position_noise=1"],
            },
            "their noise and disturbances need more than 2 GiB; give fewer",
        ),
    ],
    ids=["none", "mode", "too many"],
)
def test_an_impossible_vector_environment_is_refused(options, says):
    with pytest.raises(PlanError, match=says):
        gymnasium.make_vec(ENVIRONMENT, vectorization_mode="vector_entry_point", **options)


def test_a_plans_warnings_are_shown_except_those_about_unused_gains():
    with pytest.warns(UserWarning, match=r"reference\.value is 45 rad") as told:
        gymnasium.make(
            ENVIRONMENT, params=["pid_as_printed"], settings=["pid.reference.value=45"], rate=100.0
        )
    assert len(told) == 1


def test_wrong_calls_are_refused():
    env = gymnasium.make(ENVIRONMENT).unwrapped
    envs = gymnasium.make_vec(ENVIRONMENT, 2, "vector_entry_point")
    for one in (env, envs):
        with pytest.raises(ResetNeeded):
            one.step(one.action_space.sample())
        with pytest.raises(PlanError, match="reset: no option 'plan': give as_planned"):
            one.reset(options={"plan": True})
    with pytest.raises(PlanError, match="3 seeds for 2 environments: give one for each"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(PlanError, match="give 2 flags, of which at least one is true"):
        envs.reset(options={"reset_mask": np.zeros(2, dtype=bool)})


def test_without_gymnasium_one_line_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium.envs.registration", None)
    with pytest.raises(NotInstalledError) as caught:
        importlib.reload(trunk_experiments.gym)
    assert str(caught.value) == (
        "gymnasium is not installed; install it with: pip install -r requirements/gym.txt"
    )
