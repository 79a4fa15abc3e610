"""``trunk limit``: both sides of a limit are real runs; survival curves count the runs of a study."""

import json
from itertools import count
from math import nextafter, radians
from typing import NamedTuple

import pytest

from trunk_evidence.doubts import doubts_of
from trunk_evidence.recorded_run import RecordedRun
from trunk_studies import robustness
from trunk_studies.batch.block import RunSummary
from trunk_studies.robustness import find_limit

PUSH = [
    *("limit", "demo", "--vary", "disturbance.pulse.magnitude", "--to", "300Nm"),
    *("--set", "disturbance.pulse.channel=trunk_effort"),
]
SAME = ("--from", "0.5", "--to", "0.5")
DELAY = ("limit", "demo", "--vary", "simulator.sensor.delay")
STUDY = """
scenario: fig6
rate: 200
duration: 3.0
set: {disturbance.pulse.channel: trunk_effort, disturbance.pulse.start_times: [1.0]}
controllers: [pid, lqr]
runs: 12
vary:
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.4, high: 0.7}
"""


class PlanAt(NamedTuple):
    """As much of a plan as a search needs."""

    value: float
    controller_name: str = "pid"


def stands_below(*spans):
    """Return summaries of runs that stand where their plan's value is in one of the spans."""

    def summaries(plans):
        good = ((low <= plan.value <= high for low, high in spans) for plan in plans)
        return [RunSummary(object(), fell=not any(inside)) for inside in good]

    return summaries


def test_the_bisection_closes_in(monkeypatch):
    monkeypatch.setattr(robustness, "summaries", stands_below((0.0, 61.3)))
    done = []
    found = find_limit(PlanAt, 0.0, 100.0, 1e-3, done.append)
    assert found.stands <= 61.3 < found.falls <= found.stands + 1e-3
    assert found.stands_again == ()
    assert found.runs == done[-1] <= robustness.most_runs(0.0, 100.0, 1e-3) <= 16 * 5


@pytest.mark.parametrize("ends", [(146.89512, 146.89513), (146.89513, 146.89512), (0.0, 5e-324)])
def test_the_bisection_ends_at_neighbouring_doubles(monkeypatch, ends):
    last = ends[0] + 0.4 * (ends[1] - ends[0])
    monkeypatch.setattr(robustness, "summaries", stands_below(sorted((ends[0], last))))
    rounds = count(1)

    def progress(runs):
        assert next(rounds) < 20, "it goes on for ever"
        assert runs <= robustness.most_runs(*ends, 0.0)

    found = find_limit(PlanAt, *ends, 0.0, progress)
    assert (found.stands, found.falls) == (last, nextafter(last, ends[1]))


def test_both_sides_are_written_so_that_they_differ(command_says, monkeypatch):
    monkeypatch.setattr(robustness, "summaries", stands_magnitudes)
    words = ("limit", "demo", *PUSH[2:4], *PUSH[6:], "--controller", "pid", "--within", "1e-9")
    code, out, _ = command_says(*words, "--from", "99.99999999", "--to", "100.00000001")
    assert code == 0
    stands, falls = (float(word) for word in out.splitlines()[4].split()[1:3])
    assert 99.99999999 < stands < falls < 100.00000001


@pytest.mark.parametrize("ends", [(0.0, -100.0), (100.0, -100.0)])
def test_the_bisection_goes_downwards(monkeypatch, ends):
    monkeypatch.setattr(robustness, "summaries", stands_below((-61.3, 100.0), (-92.0, -75.0)))
    found = find_limit(PlanAt, *ends, 1e-3)
    assert found.stands >= -61.3 > found.falls >= found.stands - 1e-3
    assert all(-92.0 <= value <= -75.0 for value in found.stands_again)
    assert found.stands_again


@pytest.mark.parametrize(
    ("spans", "stands", "falls"),
    [([(0.0, 100.0)], 100.0, None), ([(-2.0, -1.0)], None, 0.0)],
    ids=["all", "none"],
)
def test_a_range_without_a_limit(monkeypatch, spans, stands, falls):
    monkeypatch.setattr(robustness, "summaries", stands_below(*spans))
    found = find_limit(PlanAt, 0.0, 100.0, 1e-3)
    assert (found.stands, found.falls) == (stands, falls)


def test_what_stands_beyond_the_first_fall_is_not_the_limit(monkeypatch):
    monkeypatch.setattr(robustness, "summaries", stands_below((0.0, 20.0), (50.0, 70.0)))
    found = find_limit(PlanAt, 0.0, 100.0, 1e-3)
    assert found.stands == pytest.approx(20.0, abs=1e-3)
    assert found.stands_again
    assert all(50.0 <= value <= 70.0 for value in found.stands_again)


def test_the_answer_says_what_the_push_is(command_says, monkeypatch):
    monkeypatch.setattr(robustness, "summaries", lambda plans: [RunSummary(None) for _ in plans])
    code, out, err = command_says(*PUSH, "--controller", "pid")
    assert (code, "trunk: runs: 100 %" in err) == (0, True)
    assert "pulses: on trunk_effort, for 0.1 s each, from t = 1, 5 s" in out
    assert "stands: the trunk stays within 90° throughout the run, 10 s" in out
    code, out, _ = command_says(*PUSH, "--controller", "pid", "--json")
    values = json.loads(out)
    assert values["pulses"] == {
        "channel": "trunk_effort",
        "start_times": [1.0, 5.0],
        "duration": 0.1,
        "magnitude": None,
    }
    assert (values["push"], values["duration"]) == (None, 10.0)
    assert values["fall_angle"] == pytest.approx(radians(90.0))


@pytest.mark.parametrize("ends", [("-300Nm", "0"), ("0", "-300Nm")])
@pytest.mark.parametrize(
    "varied", [PUSH[2:4] + PUSH[6:], ["--push", "0.1s@3", "--set", "disturbance.pulse.magnitude=0"]]
)
def test_either_end_may_be_the_one_without_a_disturbance(command_says, monkeypatch, ends, varied):
    monkeypatch.setattr(robustness, "summaries", stands_magnitudes)
    words = ("limit", "demo", *varied, "--controller", "pid", "--json")
    code, out, _ = command_says(*words, "--from", ends[0], "--to", ends[1])
    assert code == 0
    (row,) = json.loads(out)["limits"]
    if ends[0] == "0":
        assert row["stands"] >= -100.0 > row["falls"]
    else:
        assert (row["stands"], row["falls"]) == (None, -300.0)


def stands_magnitudes(plans):
    """Return summaries of runs that stand pulses and pushes of up to 100 N m."""
    magnitudes = [
        0.0
        if plan.disturbance is None
        else plan.disturbance.pulse_magnitude + sum(plan.disturbance.table_values)
        for plan in plans
    ]
    return stands_below((-100.0, 100.0))(list(map(PlanAt, magnitudes)))


def test_the_push_is_one_besides_the_scenario_s(command_says, monkeypatch):
    monkeypatch.setattr(robustness, "summaries", lambda plans: [RunSummary(None) for _ in plans])
    words = ("limit", "demo", "--push", "hip_effort=50ms@3", "--to", "1kN", "--controller", "pid")
    code, out, _ = command_says(*words)
    assert code == 0
    assert "push from 0 to 1000 N" in out
    assert "pulses: 100° on trunk_position, for 0.1 s each, from t = 1, 5 s" in out
    assert "push: on hip_effort, for 0.05 s, from t = 3 s" in out
    table = ["disturbance.table.times=[0, 1]", "disturbance.table.values=[0, 1]"]
    used = [
        word for value in (*table, "disturbance.pulse.start_times=[]") for word in ("--set", value)
    ]
    _, out, _ = command_says(*words, *used, "--json")  # the push is in the pulses
    values = json.loads(out)
    assert (values["parameter"], values["unit"], values["pulses"]) == ("push", "N", None)
    assert values["push"] == {"channel": "hip_effort", "start": 3.0, "duration": 0.05}


@pytest.mark.slow
def test_the_recordings_are_of_both_sides(command_says, tmp_path):
    code, out, _ = command_says(*PUSH, "--controller", "pid", "-o", str(tmp_path), "--json")
    assert code == 0
    (row,) = json.loads(out)["limits"]
    assert 0.0 < row["falls"] - row["stands"] <= 0.3
    stands, falls = (RecordedRun.open(path) for path in row["recordings"])
    for run, value in ((stands, row["stands"]), (falls, row["falls"])):
        assert run.plan().disturbance.pulse_magnitude == value
    fell = [doubts_of(run, twin=False).fell for run in (stands, falls)]
    assert [at is None for at in fell] == [True, False]
    code, _, err = command_says(*PUSH, "--controller", "pid", "-o", str(tmp_path))
    assert (code, "it exists" in err) == (2, True)


@pytest.mark.slow
def test_a_survival_curve_counts_a_study_s_runs(command_says, tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    words = ["limit", "--study", str(path), *PUSH[2:4], "--to", "600", "--points", "4"]
    picture = tmp_path / "survival.svg"
    code, out, _ = command_says(*words, "-o", str(picture), "--json")
    assert code == 0
    curves = {curve["controller"]: curve for curve in json.loads(out)["survival"]}
    assert set(curves) == {"pid", "lqr"}
    for curve in curves.values():
        shares = [point["share"] for point in curve["points"]]
        assert (curve["runs"], shares[0], shares[-1]) == (12, 1.0, 0.0)
        assert 0.0 < curve["half_falls_at"] < 600.0
        assert all(p["low"] <= p["share"] <= p["high"] for p in curve["points"])
    assert "runs that stand" in picture.read_text()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["limit", "--vary", "simulator.sensor.delay", "--to", "1"], "give a SCENARIO, or --study"),
        ([*DELAY, *SAME], "two different finite values"),
        (["limit", "demo", "--to", "1"], "give --vary NODE.PARAM, or --push"),
        ([*DELAY, "--push", "0.1s", "--to", "1"], "give --vary NODE.PARAM, or --push"),
        (["limit", "demo", "--push", "60Nm:0.1s", "--to", "1"], "its value varies: leave it out"),
        (["limit", "demo", "--push", "hip=0.1s", "--to", "1"], "CHANNEL one of hip_effort"),
        (["limit", "demo", "--push", "0.1s", "--to", "5kg"], "it is a mass"),
        (["limit", "fig6", *PUSH[2:]], "nothing disturbs at either end"),
        ([*DELAY, "--to", "5kg"], "it is a mass"),
        (
            ["limit", "demo", "--vary", "simulator.sensor.delay", "--to", "99"],
            "--vary simulator.sensor.delay --to 99: simulator: parameter 'sensor.delay': 99 is not",
        ),
        (
            ["limit", "demo", "--vary", "simulator.sensor.delay", "--to", "1", "-o", __file__],
            "a file: give a folder",
        ),
        (["limit", "demo", "--vary", "simulator.hip.mode", "--to", "5"], "hip.mode"),
        (["limit", "demo", "--vary", "lqr.gains.p", "--to", "5"], "no node of this run takes it"),
        (
            [*PUSH[:3], "disturbance.pulse.magnitude", "--to", "300Nm"],
            "pulse.channel chooses the unit",
        ),
    ],
)
def test_mistakes_are_one_line(command_says, words, says):
    code, _, err = command_says(*words)
    assert code == 2
    assert says in err
    assert len(err.strip().splitlines()) == 1


def test_an_element_of_an_array_may_vary_and_angles_are_in_degrees(command_says):
    vary = ("--vary", "simulator.initial.position[1]", "--controller", "pid", "--within", 0.01)
    code, out, _ = command_says("limit", "fig6", *vary, "--from", "0deg", "--to", "120deg")
    assert code == 0
    assert "simulator.initial.position[1] from 0 to 120°" in out.splitlines()[0]
    assert "stands, °" in out
    whole = ("--vary", "simulator.initial.position", "--to", "1")
    code, _, err = command_says("limit", "fig6", *whole)
    assert (code, err.count("\n")) == (2, 1)
