"""An environment's episodes equal offline runs, recordings and one another, bit for bit."""

import re
from dataclasses import replace

import gymnasium
import numba
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.wrappers import TransformAction

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.compiled import compiled
from trunk_core.errors import ActionError, PlanError
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.gym import ENVIRONMENT
from trunk_experiments.gym.episodes import Episodes, advance_of
from trunk_experiments.gym.task import make_task
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_sim.plants.trunk import passive
from trunk_sim.step import Dynamics, on_second
from trunk_views.comparison import different_tasks
from trunk_views.run_view import RunView

from ...trunk_runs.test.stepwise import steps

NOISY = [
    "simulator.sensor.position_noise=0.01",
    "simulator.sensor.velocity_noise=0.02",
    "simulator.sensor.position_bias=0.003",
    "simulator.sensor.delay=0.02",
    "disturbance.noise.rms=0.5",
]
OPTIONS = {
    "demo": {},
    "noise, delay": {"settings": NOISY},
    "slow controller": {
        "settings": ["simulator.update_rate=1000", "disturbance.update_rate=1000", *NOISY]
    },
    "step": {"scenario": "fig7"},
    "fall": {"scenario": "fig8", "settings": ["simulator.fall.stop=true"]},
    "fall, slow": {
        "scenario": "fig8",
        "settings": [
            "simulator.fall.stop=true",
            "pid.update_rate=100",
            "simulator.sensor.delay=0.01",
        ],
    },
    "fall is no end": {"scenario": "fig8", "settings": ["simulator.fall.stop=false"]},
    "tables and random pulses": {
        "settings": [
            "disturbance.pulse.random_count=3",
            "disturbance.pulse.random_until=1.5",
            "disturbance.pulse.random_seed=7",
            "disturbance.table.times=[0.2, 0.9]",
            "disturbance.table.values=[1.0, -1.0]",
            "pid.reference.profile=interpolated",
            "pid.reference.times=[0.0, 1.0]",
            "pid.reference.values=[0.0, 0.2]",
        ]
    },
    "walking": {"scenario": "fig6", "params": ["profile_walking"]},
    "gait": {
        "params": ["profile_walking"],
        "settings": ["simulator.path.cosines=[0.005]", "simulator.path.sines=[0.0, 0.01]"],
    },
    "back-calculation": {
        "settings": ["pid.antiwindup_strategy=back_calculation", "simulator.max_effort=20"]
    },
}
SHORT = {"duration": 1.501}  # s; a slow controller's last step is then shorter than the others
PLANNED = {"as_planned": True}
each_option = pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)


def made(**options):
    return gymnasium.make(ENVIRONMENT, **options).unwrapped


def bits(values):
    return np.asarray(values, dtype=np.float64).view(np.int64).tolist()


def offline(options):
    """Return the plan and the offline run of ``pid``; its torques or gains are the environment's actions."""
    given = {"scenario": "demo", "params": (), "settings": ()} | options
    plan = make_plan(given["scenario"], "pid", given["params"], given["settings"], SHORT)
    return plan, list(steps(plan))


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("action", ["torque", "gains"])
@each_option
def test_an_episode_as_planned_is_the_offline_run_bit_for_bit(options, action):
    plan, run = offline(options)
    env = made(action=action, **SHORT, **options)
    every = round(plan.simulator.update_rate / plan.controller.update_rate)
    seen, _ = env.reset(options=PLANNED)
    for k in range(0, len(run) - 1, every):
        step = run[k]
        truth, measured = step.truth, step.measured
        hip, angle = measured.position
        hip_rate, rate = measured.velocity
        assert bits(seen) == bits([angle, rate, step.answer.reference, hip, hip_rate]), k
        given = [step.answer.effort] if action == "torque" else plan.controller.gains
        seen, _, terminated, truncated, info = env.step(np.array(given))
        after = run[min(k + every, len(run) - 1)]
        assert info["step"] == min(k + every, len(run) - 1)
        truth = after.truth
        assert bits([info["angle"], info["torque"]]) == bits(
            [truth.position[1], truth.effort[1]]
        ), k
        ends = k + every >= len(run) - 1
        fell = plan.simulator.fall_stop and after.falls
        assert (terminated, truncated) == (ends and fell, ends and not fell)
    assert bits(seen[:2]) == bits([run[-1].measured.position[1], run[-1].measured.velocity[1]])


def test_random_pulses_are_drawn_for_each_episode():
    task = make_task(settings=OPTIONS["tables and random pulses"]["settings"])
    assert task.draws_disturbances
    drawn = [task.draw(np.random.default_rng(seed)) for seed in (1, 1, 2)]
    first, again, other = (task.plan_of(one).disturbance.signals for one in drawn)
    assert first == again
    assert first.pulse_starts != other.pulse_starts
    assert first.table_values == other.table_values


def test_the_reward_is_the_cost_of_error_and_torque():
    """And a fall costs as much as lying at fall.angle until the end."""
    plan, run = offline(OPTIONS["fall"])
    env = made(effort_weight=1e-3, **SHORT, **OPTIONS["fall"])
    env.reset(options=PLANNED)
    h = 0.001
    for k in range(len(run) - 1):
        _, reward, terminated, *_ = env.step(np.array([run[k].answer.effort]))
        error, torque = run[k + 1].truth.position[1], run[k + 1].truth.effort[1]
        wanted = -h * (error**2 + 1e-3 * torque**2)
        if terminated:
            wanted -= (1.501 - (k + 1) * h) * plan.simulator.fall_angle**2
        assert reward == pytest.approx(wanted, rel=1e-12)
    assert terminated


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("action", ["torque", "gains"])
@each_option
def test_the_same_seed_gives_the_same_bits_alone_and_in_any_lane(options, action):
    count, length = 18, 40  # of two blocks
    many = gymnasium.make_vec(
        ENVIRONMENT, count, "vector_entry_point", action=action, **SHORT, **options
    )
    alone = {i: made(action=action, **SHORT, **options) for i in (0, 15, 17)}
    seen, _ = many.reset(seed=5)
    for i, env in alone.items():
        assert bits(env.reset(seed=5 + i)[0]) == bits(seen[i])
    assert len({tuple(bits(one)) for one in seen}) == count
    generator = np.random.default_rng(1)
    low, high = many.single_action_space.low, many.single_action_space.high
    low, high = np.maximum(low, -5.0), np.minimum(high, 5.0)
    for _ in range(length):
        actions = generator.uniform(low, high, (count, len(low)))
        got = many.step(actions)
        for i, env in alone.items():
            observation, reward, terminated, truncated, info = env.step(actions[i])
            assert bits(observation) == bits(got[0][i])
            assert bits(reward) == bits(got[1][i])
            assert (terminated, truncated) == (got[2][i], got[3][i])
            assert bits(info["torque"]) == bits(got[4]["torque"][i])


def played(env, policy=lambda seen: 0.0, longest=10_000):
    seen, _ = env.reset(seed=2)
    for _ in range(longest):
        seen, _, terminated, truncated, _ = env.step(np.array([policy(seen)]))
        if terminated or truncated:
            return terminated
    return False


def balanced(seen):
    return float(60.0 * (seen[2] - seen[0]) - 9.0 * seen[1])


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("policy", "longest", "reason"),
    [
        (balanced, 10_000, "finished"),
        (balanced, 77, "finished"),
        (lambda seen: 0.0, 10_000, "the trunk has fallen"),
    ],
    ids=["whole", "in the middle", "fallen"],
)
@pytest.mark.parametrize("name", ["demo", "noise, delay", "slow controller"])
def test_a_saved_episode_is_verified(tmp_path, name, policy, longest, reason):
    env = made(**SHORT, **OPTIONS[name])
    played(env, policy, longest)
    recording = Recording.open(env.save(tmp_path / "episode.mcap"))
    assert recording.end["reason"] == reason
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    assert "policy, another controller" in verdict.unjudged[0]
    states = int(env._episodes.steps[0]) + 1
    assert recording.topics[f"/{topics.GROUND_TRUTH}"].count == states
    truth = recording.joints(f"/{topics.GROUND_TRUTH}").by_stamp()
    assert bits(truth.column("position", "trunk")[-1]) == bits(env._episodes.angles[0])


def test_a_saved_episode_with_gains_as_actions_contains_them_and_is_verified(tmp_path):
    env = made(action="gains", **SHORT)
    env.reset(seed=1)
    given = [np.array([50.0 + k, 20.0, 8.0 + 0.1 * k]) for k in range(30)]
    commands = []
    for one in given:
        commands.append(env.step(one)[4]["torque"])
    recording = Recording.open(env.save(tmp_path / "episode.mcap"))
    assert verify(recording).exit_code == VERIFIED
    terms = recording.joints("/policy/state").by_stamp()
    recorded = np.column_stack([terms.column("position", name) for name in ("kp", "ki", "kd")])
    assert bits(recorded) == bits(given)
    assert bits(terms.column("position", "effort")) == bits(commands)


def test_a_diverged_episode_is_incomplete(tmp_path):
    settings = ["simulator.fall.stop=false", "simulator.update_rate=2", "pid.update_rate=2"]
    env = made(scenario="fig6", settings=settings, duration=100.0)
    env.reset(options=PLANNED)
    terminated = False
    while not terminated:
        *_, terminated, truncated, info = env.step(np.array([1e200]))
        assert not truncated
    assert info["diverged"]
    with pytest.raises(ResetNeeded, match="the episode has ended"):
        env.step(np.array([0.0]))
    recording = Recording.open(env.save(tmp_path / "episode.mcap"))
    assert recording.end["complete"] == "false"
    assert verify(recording).exit_code == UNJUDGED


def test_save_neither_overwrites_a_file_nor_works_before_a_step(tmp_path):
    env, path = made(**SHORT), tmp_path / "episode.mcap"
    with pytest.raises(PlanError, match="the episode has no step yet: step first"):
        env.save(path)
    played(env, balanced, 3)
    recording = Recording.open(env.save(path))
    assert recording.topics[f"/{topics.GROUND_TRUTH}"].count == 4
    assert recording.end["reason"] == "finished"
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match=r"episode\.mcap exists"):
        env.save(path)
    assert path.read_bytes() == before
    env.step(np.array([1.0]))
    env.save(path, overwrite=True)
    assert path.read_bytes() != before


def test_a_command_beyond_the_limits_is_clipped_as_in_the_plant():
    env = made(settings=["simulator.max_effort=7"], **SHORT)
    assert (env.action_space.low, env.action_space.high) == (-7.0, 7.0)
    env.reset(seed=1)
    assert env.step(np.array([55.0]))[4]["torque"] == 7.0
    assert (
        TransformAction(env, lambda a: -a, env.action_space).step(np.array([55.0]))[4]["torque"]
        == -7.0
    )


@pytest.mark.parametrize(
    ("action", "says"),
    [
        ([np.nan], "action: number 0 of environment 0 is nan: it must be finite"),
        ([1.0, 2.0], r"action: its shape is \(2,\), it must be \(1,\)"),
        ([[1.0]], r"action: its shape is \(1, 1\), it must be \(1,\)"),
        (1.0, r"action: its shape is \(\), it must be \(1,\)"),
        ("x", r"action: 'x': give real numbers, an array of shape \(1,\)"),
        (["1"], r"action: \['1'\]: give real numbers"),
        ([1j], r"action: \[1j\]: give real numbers"),
        ([[1.0], []], r"action: \[\[1.0\], \[\]\]: give real numbers"),
    ],
)
def test_an_invalid_action_is_refused_and_changes_nothing(action, says):
    env = made(**SHORT)
    env.reset(seed=1)
    with pytest.raises(ActionError, match=says):
        env.step(action)
    other = made(**SHORT)
    other.reset(seed=1)
    assert bits(env.step(np.array([1.0]))[0]) == bits(other.step(np.array([1.0]))[0])


def test_an_episode_is_ranked_among_runs_with_the_same_reference(tmp_path):
    """The reference is taken from the recorded terms: a policy's parameters are not on record."""
    env = made(**SHORT)
    played(env, balanced)
    views = [RunView.read(RecordedRun.open(env.save(tmp_path / "episode.mcap")))]
    for i, reference in enumerate((0.0, 0.1)):
        settings = ["simulator.fall.stop=true", f"pid.reference.value={reference}"]
        plan = env.task.plan_of(env._drawn)
        ours = make_plan("demo", "pid", (), settings, SHORT)
        record_offline(replace(ours, simulator=plan.simulator), tmp_path / f"{i}.mcap")
        views.append(RunView.read(RecordedRun.open(tmp_path / f"{i}.mcap")))
    assert different_tasks(views[:2]) == ()
    assert different_tasks(views[::2]) == ("reference",)


@pytest.mark.slow
def test_the_plants_steps_are_vector_code():
    episodes = Episodes(make_task("fig8"), 16)
    advance = advance_of(law_named("pid"), Dynamics(on_second, passive), None)
    compiled(advance)  # registers what it calls
    twin = numba.njit(advance, error_model="numpy", nogil=True, _nrt=False)
    given = (episodes.course, episodes._blocks, episodes.steps, episodes._series, episodes._history)
    twin.compile(tuple(map(numba.typeof, (*given, np.zeros((16, 1))))))
    code = "\n".join(twin.inspect_llvm().values())
    assert len(re.findall(r"fdiv <\d+ x double>", code)) >= 8, "two for each stage of a step"
