"""Tuning: poles where requested, margins that a simulation confirms, files that nodes load."""

import re

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.lqr import LqrConfig
from trunk_core.errors import PlanError, TuningError
from trunk_experiments.cli import trunk
from trunk_experiments.commands.tune import command
from trunk_runs.plan import make_plan
from trunk_sim.config import TrunkSimulator
from trunk_studies.tuning import search
from trunk_studies.tuning.linear import Linear, linearise
from trunk_studies.tuning.methods import by_lqr, by_poles, relay, ultimate
from trunk_studies.tuning.search import fuzzy_space, gains_space

PLANT = linearise(TrunkSimulator())


def test_linearise_gives_the_textbook_pendulum():
    found = linearise(TrunkSimulator(trunk_mass=2.0, length=0.5, gravity=9.0))
    assert (found.a, found.b) == (pytest.approx(18.0), pytest.approx(2.0))


@pytest.mark.parametrize("length", [1e-200, 1e-160])
def test_a_plant_beyond_floating_point_is_refused(length):
    with pytest.raises(PlanError, match=f"cannot be linearised: .* with .*length={length},"):
        linearise(TrunkSimulator(length=length))


@given(st.lists(st.floats(-40.0, -0.5), min_size=2, max_size=3, unique=True))
@settings(max_examples=60)
def test_by_poles_places_the_poles(poles):
    if min(np.diff(sorted(poles))) < 0.05:
        return  # nearly double: polynomial roots are less exact there
    p, i, d = by_poles(PLANT, poles).p, by_poles(PLANT, poles).i, by_poles(PLANT, poles).d
    polynomial = [1.0, PLANT.b * d, PLANT.b * p - PLANT.a, PLANT.b * i]
    found = np.sort(np.roots(polynomial[: len(poles) + 1]).real)
    assert found == pytest.approx(sorted(poles), rel=1e-4)


@pytest.mark.parametrize("poles", [(-1.0,), (-1.0, -1.0), (1.0, -2.0)], ids=str)
def test_impossible_poles_are_refused(poles):
    with pytest.raises(TuningError, match="distinct negative"):
        by_poles(PLANT, poles)


def test_by_lqr_gives_the_nodes_defaults():
    gains = by_lqr(PLANT, 0.1, np.radians(6.0), 1.0, 5.0)
    assert gains == pytest.approx(LqrConfig().gains, rel=1e-5)


WEIGHTS = 0.1, np.radians(6.0), 1.0, 5.0


def cost_of(gains, start, period):
    """The cost of LQR's sampled loop from a state (law's integral, angle, rate): Simpson's rule."""
    fine, weights = 10, np.array([value**-2 for value in WEIGHTS])
    step, rate = period / fine, np.sqrt(PLANT.a)
    over = np.array(
        [
            [np.cosh(rate * step), np.sinh(rate * step) / rate],
            [rate * np.sinh(rate * step), np.cosh(rate * step)],
        ]
    )
    simpson = np.array([1.0] + [4.0, 2.0] * (fine // 2 - 1) + [4.0, 1.0]) * step / 3.0
    total, (integral, *moving) = 0.0, start
    for _ in range(1500):
        torque = -(gains.i * integral + gains.p * moving[0] + gains.d * moving[1])
        rest = np.array([-PLANT.b * torque / PLANT.a, 0.0])
        points = [(integral, *moving)]
        for _ in range(fine):  # the integral goes on from the law's by Simpson's rule, too
            before = np.array(moving)
            half = half_a_step_on(before - rest, rate, step) + rest[0]
            moving = over @ (before - rest) + rest
            area = (before[0] + 4.0 * half + moving[0]) * step / 6.0
            points.append((points[-1][0] + area, *moving))
        squares = np.column_stack([np.square(points), np.full(fine + 1, torque**2)])
        total += simpson @ squares @ weights
        integral += period * moving[0]
    assert np.max(np.abs([integral, *moving])) < 1e-6
    return total


def half_a_step_on(offset, rate, step):
    """The angle half a step on, from an offset to where gravity and torque balance."""
    return offset[0] * np.cosh(rate * step / 2) + offset[1] * np.sinh(rate * step / 2) / rate


@pytest.mark.slow
@pytest.mark.parametrize("start", [(0.01, 0.0, 0.0), (0.0, 0.1, 0.0), (0.01, -0.1, 0.3)], ids=str)
def test_discrete_lqr_costs_least_of_all_sampled_gains(start):
    period = 0.01
    best = by_lqr(PLANT, *WEIGHTS, period)
    least = cost_of(best, start, period)
    assert cost_of(by_lqr(PLANT, *WEIGHTS), start, period) > least
    for (
        name
    ) in "pid":  # where the parabola through three costs has its vertex, as a factor on the gain
        below, above = (
            cost_of(best._replace(**{name: getattr(best, name) * f}), start, period)
            for f in (0.98, 1.02)
        )
        vertex = 0.01 * (below - above) / (below - 2.0 * least + above)
        assert min(below, above) > least
        assert vertex == pytest.approx(0.0, abs=5e-4)


def test_discrete_lqr_approaches_the_continuous_one():
    continuous = by_lqr(PLANT, *WEIGHTS)
    assert by_lqr(PLANT, *WEIGHTS, 1e-6) == pytest.approx(continuous, rel=1e-4)
    assert by_lqr(PLANT, *WEIGHTS, 0.01).i == pytest.approx(0.91 * continuous.i, rel=0.01)


def test_tune_lqr_discrete_takes_the_rate():
    run = CliRunner().invoke(trunk, ["tune", "lqr", "--discrete", "--rate", "100"])
    assert "gains.i               45.5897" in run.output, run.output


def test_the_relay_agrees_with_routh():
    plant = Linear(PLANT.a, PLANT.b, c=4.0, lag=0.02)
    found = relay(plant, 1.0)
    assert (found.exact_gain, found.exact_period) == ultimate(plant)
    assert found.gain == pytest.approx(
        found.exact_gain, rel=0.1
    )  # the accuracy of a describing function
    assert found.period == pytest.approx(found.exact_period, rel=0.08)
    poles = np.roots([0.02, 1.08, 4.0 - 0.02 * plant.a, plant.b * found.exact_gain - plant.a])
    assert np.max(poles.real) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("lag", "damping", "mass", "gain"),
    [
        (0.02, 0.5, 0.5, 22.2997),
        (0.05, 1.0, 0.5, 19.6447),
        (0.01, 0.3, 0.5, 25.9201),
        (0.03, 2.0, 1.5, 61.2828),
    ],
)
def test_the_relay_finds_the_exact_limit_cycle(lag, damping, mass, gain):
    """Tsypkin's, computed independently."""
    plant = linearise(TrunkSimulator(trunk_mass=mass))
    assert relay(plant._replace(c=damping * plant.b, lag=lag), 1.0).gain == pytest.approx(
        gain, abs=1e-4
    )


@pytest.mark.parametrize("plant", [PLANT, PLANT._replace(lag=0.02), PLANT._replace(c=1.0)], ids=str)
def test_the_relay_needs_lag_and_damping(plant):
    with pytest.raises(TuningError, match="no ultimate gain"):
        relay(plant, 1.0)


def test_the_search_starts_from_the_current_parameters():
    config = FuzzyPidConfig()
    space = fuzzy_space(config)
    values = space.values(np.array(space.start))
    assert values["rules.kp"] == config.rules_kp
    assert values["rules.alpha"] == config.rules_alpha
    assert values["gains.p_max"] == pytest.approx(config.p_max)
    changed = [i for i in range(7) if values["rules.kd"][i] != config.rules_kd[i]]
    assert changed == [1]  # the misprinted cell: the search keeps the tables symmetric
    assert gains_space(LqrConfig()).values(np.zeros(3)) == dict.fromkeys(
        ("gains.p", "gains.i", "gains.d"), 1.0
    )


def invoke(*arguments):
    return CliRunner().invoke(command, list(map(str, arguments)), catch_exceptions=False)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("controller", "arguments"),
    [
        ("pid", ["poles"]),
        (
            "computed_torque",
            ["poles", "--controller", "computed_torque", "--pole", -9, "--pole", -11],
        ),
        ("lqr", ["lqr", "--torque", 8]),
        ("pid", ["relay", "--lag", 0.02, "--damping", 2.0]),
    ],
    ids=["poles", "computed_torque", "lqr", "relay"],
)
@pytest.mark.slow
def test_the_file_is_loaded_by_a_run(controller, arguments, tmp_path):
    path = tmp_path / "gains.yaml"
    said = invoke(*arguments, "-o", path)
    assert said.exit_code == 0
    assert "delay ms" in said.output
    plan = make_plan("fig6", controller, [str(path)])
    assert plan.controller != make_plan("fig6", controller).controller


@pytest.mark.slow
@pytest.mark.parametrize(
    "controller", ["pid", pytest.param("fuzzy_pid", marks=pytest.mark.one_in(8))]
)
def test_a_search_is_reproducible_and_no_worse_than_its_start(controller, tmp_path):
    texts = []
    for name in ("a.yaml", "b.yaml"):
        arguments = ["--generations", 1, "--population", 2, "--scenario", "fig6"]
        said = invoke(
            "optimise", "--controller", controller, *arguments, "-o", tmp_path / name, "--rate", 200
        )
        assert said.exit_code == 0
        texts.append((tmp_path / name).read_text())
        before, after = (float(said.output.split(w)[0].split()[-1]) for w in (" before", " after"))
        assert after <= before
    assert texts[0] == texts[1]
    assert make_plan("fig6", controller, [str(tmp_path / "a.yaml")])


def test_a_single_number_is_searched_without_a_warning(monkeypatch, capsys):
    plan = make_plan("fig6", "pid", [], ["simulator.duration=0.5"], {"update_rate": 200.0})
    space = gains_space(plan.controller)
    single = space._replace(
        bounds=space.bounds[:1],
        start=space.start[:1],
        values=lambda x: {"gains.p": 10.0 ** x.item()},
    )
    monkeypatch.setattr(search, "space_of", lambda *_: single)
    optimum = search.search([plan], "iae", 2, 3, 1, 1, lambda *_: None)
    assert optimum.after < optimum.before
    assert list(optimum.values) == ["gains.p"]
    assert "1-D" not in "".join(capsys.readouterr())  # what the library says of a single number


def test_of_two_runs_one_may_fall_and_costs_ten_times_the_other(monkeypatch):
    settings = ["simulator.fall.stop=true", "simulator.duration=1.0"]
    plans = [
        make_plan("fig6", "pid", [], [*settings, f"simulator.fall.angle={angle}"], everywhere)
        for everywhere in [{"update_rate": 200.0}]
        for angle in (0.05, 1.0)
    ]
    told: list[tuple[int, float]] = []
    optimum = search.search(plans, "effort", 1, 3, 1, 1, lambda *progress: told.append(progress))
    fell, stood = search.metrics_of(plans, "effort", [{}])[0]
    assert np.isnan(fell)
    assert optimum.fall_costs == 10.0 * stood
    assert optimum.before == (stood + optimum.fall_costs) / 2.0
    assert told == [(1, optimum.after)]
    assert optimum.after <= optimum.before
    assert optimum.runs == (1 + 3) * 2
    with pytest.raises(PlanError, match="pid falls in each of 1 runs"):
        search.search(plans[:1], "effort", 1, 3, 1, 1, lambda *_: None)
    monkeypatch.setattr(search, "metrics_of", lambda *_: np.array([[np.nan, 0.0]]))
    with pytest.raises(PlanError, match="overshoot_deg is 0 in each run of pid that stands"):
        search.search(plans, "overshoot_deg", 1, 3, 1, 1, lambda *_: None)


@pytest.mark.parametrize(
    ("duration", "says"), [("0.0", "needs an end"), ("1e6", "at most 20000000")]
)
def test_a_search_over_impossible_runs_is_refused(duration, says):
    with pytest.raises(PlanError, match=f"fig6: .*{says}"):
        invoke("optimise", "--set", f"simulator.duration={duration}")


@pytest.mark.parametrize("verb", [["poles"], ["lqr"], ["optimise"]], ids=str)
def test_a_missing_folder_is_reported_first(tmp_path, verb):
    with pytest.raises(PlanError, match="there is no folder"):
        invoke(*verb, "-o", tmp_path / "none" / "gains.yaml")


def test_a_unit_that_the_plant_chooses_is_said_to_be_the_trunks():
    options = [option for verb in command.commands.values() for option in verb.params]
    chosen = [
        option for option in options if re.search(r", (N )?m\b", getattr(option, "help", "") or "")
    ]
    assert len(chosen) == 5
    assert [o.name for o in chosen if not o.help.endswith(" on the trunk.")] == []


def test_an_error_about_the_linear_plant_names_no_unit_of_the_drive():
    with pytest.raises(TuningError, match=r"values .*, 1e\+06 .*closer to one another$") as far:
        by_lqr(PLANT, 1e-6, 1e-6, 1e-6, 1e6)
    with pytest.raises(TuningError, match=r"declare both$") as undamped:
        ultimate(PLANT._replace(lag=0.1))
    assert "N m" not in f"{far.value} {undamped.value}"


@pytest.mark.one_in(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("pid.gains.p=4", "this verb computes the gains"),
        ("recorder.output=a.mcap", "nothing is run"),
        ("simulator.initial.position=[0,0.3]", "linearised about the upright"),
        ("simulator.path.amplitude=2.0", "on level ground"),
    ],
)
def test_a_setting_without_effect_gets_a_warning(setting, says):
    result = CliRunner().invoke(trunk, ["tune", "poles", "--set", setting])
    assert result.exit_code == 0
    (line,) = [one for one in result.stderr.splitlines() if setting in one]
    assert line.startswith("trunk: warning: --set ")
    assert says in line
