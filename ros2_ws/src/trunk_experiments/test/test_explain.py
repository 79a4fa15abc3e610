"""`trunk explain`: one update, term by term, equal to what was recorded."""

import json
import re
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_evidence.explanation import explain
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.cli import trunk
from trunk_recording.reader import RecordingError
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import Swap, make_plan
from trunk_runs.timeline import Change

FIELDS = ("error", "error_rate", "p_term", "i_term", "d_term", "kp", "ki", "kd", "alpha")


@pytest.mark.slow
@pytest.mark.one_in(5)
@pytest.mark.parametrize("scenario", ["fig8", "demo"])
@pytest.mark.parametrize("controller", ["pid", "fuzzy_pid", "lqr", "computed_torque"])
@pytest.mark.parametrize("at", [0.0, 0.5, 1.0, 1.05, 1.1, 1.3])
def test_terms_equal_the_recorded_ones(short_run, scenario, controller, at):
    run = RecordedRun.open(short_run(scenario, controller))
    found = explain(run, at)
    state = run.joints(f"{controller}/state")
    row = int(np.flatnonzero(state.stamp_ns <= round(at * 1e9))[-1])
    assert found.update_s == state.stamp_ns[row] / 1e9
    for name in (*FIELDS, "unsaturated", "effort"):
        assert getattr(found.terms, name) == state.column("position", name)[row], name
    assert found.agrees
    assert found.recorded == found.applied == found.terms.effort


def test_rules_make_the_gains(short_run):
    found = explain(RecordedRun.open(short_run("fig8", "fuzzy_pid")), 0.7)
    total = {
        n: sum(r.weight * c.value for r in found.rules for c in r.consequents if c.output == n)
        for n in ("kp", "kd", "alpha")
    }
    assert found.terms.kp == pytest.approx(32.0 + 28.0 * total["kp"], rel=1e-14)
    assert found.terms.kd == pytest.approx(9.6 + 8.4 * total["kd"], rel=1e-14)
    assert found.terms.alpha == pytest.approx(total["alpha"], rel=1e-14)
    weights = [rule.weight for rule in found.rules]
    assert weights == sorted(weights, reverse=True)
    # The first state: e = -30 deg is the peak of NS, e_dot = 0 that of ZO; Tables 2 to 4 say B, S, S.
    first = explain(RecordedRun.open(short_run("fig8", "fuzzy_pid")), 0.0).rules[0]
    assert (first.error_label, first.rate_label) == ("NS", "ZO")
    assert [c.label for c in first.consequents] == ["B", "S", "S"]


def test_a_plain_pid_has_no_rules(short_run):
    assert explain(RecordedRun.open(short_run("fig8", "pid")), 0.7).rules == ()


def test_what_a_model_adds(short_run):
    assert explain(RecordedRun.open(short_run("fig8", "pid")), 0.7).by_model == 0.0
    found = explain(RecordedRun.open(short_run("fig8", "computed_torque")), 0.7)
    terms = found.terms
    assert found.by_model != 0.0
    total = terms.p_term + terms.i_term + terms.d_term + found.by_model
    assert total == pytest.approx(terms.unsaturated, rel=1e-12)


def test_the_pulse_that_acted(short_run):
    run = RecordedRun.open(short_run("fig8", "pid"))
    inside, outside = explain(run, 1.05), explain(run, 1.2)
    assert inside.disturbance.trunk_offset == 100.0 * pi / 180.0
    assert inside.measurement == pytest.approx(inside.true_angle + inside.disturbance.trunk_offset)
    assert not any(outside.disturbance)


def test_limits_and_anti_windup(short_run):
    run = RecordedRun.open(short_run("demo", "fuzzy_pid"))
    limited, free = explain(run, 1.0), explain(run, 0.5)
    assert limited.limited
    assert limited.terms.effort == -100.0 > limited.terms.unsaturated
    assert limited.anti_windup.acted
    assert limited.anti_windup.after == limited.anti_windup.before != limited.anti_windup.used
    assert not free.limited
    assert not free.anti_windup.acted
    assert free.anti_windup.after == free.anti_windup.before + free.anti_windup.increment


def test_between_updates_the_held_command_is_explained(short_run):
    run = short_run("fig8", "pid", settings=("pid.update_rate=100.0",))
    found = explain(RecordedRun.open(run), 0.5079)
    assert found.update_s == 0.5
    assert found.anti_windup.increment == pytest.approx(0.01 * found.terms.error)
    assert found.agrees


def test_a_handover_has_its_own_limits(tmp_path):
    """Without an integral, which could take over the torque, the command moves step by step."""
    settings = ["simulator.duration=1.5", "pid.gains.i=0.0"]
    plan = make_plan("demo", "fuzzy_pid", settings=settings, swaps=[Swap(1.02, "pid")])
    path = tmp_path / "run.mcap"
    record_offline(plan, path)
    found = explain(RecordedRun.open(path), 1.03)
    assert (found.handing_over, found.agrees) == (True, True)
    first = explain(RecordedRun.open(path), 1.02)
    assert (first.took_over, first.handing_over, first.agrees) == (True, True, True)
    assert first.terms.effort in first.limits
    low, high = found.limits
    assert high - low == pytest.approx(2.0 * plan.controllers["pid"].handover_step)
    assert found.terms.effort in found.limits
    says = CliRunner().invoke(trunk, ["explain", str(path), "--at", "1.03"]).output
    assert "limits of the handover" in says
    before = explain(RecordedRun.open(path), 1.0)
    assert (before.handing_over, before.limits) == (False, (-100.0, 100.0))


def test_the_first_update_after_a_reset(tmp_path):
    plan = make_plan("fig8", "pid", settings=["pid.update_rate=100.0", "simulator.duration=0.6"])
    plan = replace(plan, changes={"pid": [Change(503_000_000, None)]})
    record_offline(plan, tmp_path / "run.mcap")
    found = explain(RecordedRun.open(tmp_path / "run.mcap"), 0.505)
    assert found.update_s == 0.504
    assert found.anti_windup.before == 0.0
    assert found.anti_windup.increment == 0.01 * found.terms.error  # its period, not the 4 ms since
    assert not found.anti_windup.acted
    assert found.agrees


@pytest.mark.parametrize("at", [-0.1, 1.4, float("nan")])
def test_a_time_outside_the_run(short_run, at):
    with pytest.raises(RecordingError, match=r"from t = 0 s to t = 1\.3 s"):
        explain(RecordedRun.open(short_run("fig8", "pid")), at)


def test_the_command(short_run):
    run = str(short_run("demo", "fuzzy_pid"))
    shown = CliRunner().invoke(trunk, ["explain", run, "--at", "1.0"])
    assert shown.exit_code == 0
    for words in ("trunk offset", "NB", "-100 … 100", "limited", "acted", "bit for bit"):
        assert words in shown.output, words
    values = json.loads(CliRunner().invoke(trunk, ["explain", run, "--at", "1", "--json"]).output)
    assert values["agrees"] is True
    assert values["limits"] == [-100.0, 100.0]
    assert len(values["rules"]) == 4
    plain = CliRunner().invoke(
        trunk, ["explain", str(short_run("fig8", "pid")), "--at", "1", "--json"]
    )
    assert json.loads(plain.output)["limits"] == [None, None]


@pytest.fixture(scope="module")
def on_a_cart(tmp_path_factory):
    plan = make_plan("cart_pole", "state_feedback", settings=["simulator.duration=0.5"])
    path = tmp_path_factory.mktemp("cart") / "run.mcap"
    record_offline(plan, path)
    return path


@pytest.mark.parametrize("at", [0.0, 0.3])
def test_what_each_state_asks_for(on_a_cart, at):
    run = RecordedRun.open(on_a_cart)
    found, config = explain(run, at), run.parameters["state_feedback"]
    position, rate = found.hip
    states = run.joints("joint_states")
    row = int(np.flatnonzero(states.stamp_ns <= round(at * 1e9))[-1])
    x, v = (states.column(kind, "cart")[row] for kind in ("position", "velocity"))
    kx, kv = config["gains.x"], config["gains.v"]
    assert position == ("cart position", "x", x, "m", kx, "N/m", -kx * x)
    assert rate == ("cart rate", "v", v, "m/s", kv, "N s/m", -kv * v)
    assert position.share + rate.share == pytest.approx(found.by_model, abs=1e-12)
    says = CliRunner().invoke(trunk, ["explain", str(on_a_cart), "--at", str(at)]).output
    cells = (re.split(r"  +", line.strip()) for line in says.split("\n"))
    rows = {name: rest for name, *rest in cells}
    assert rows["cart position"] == [f"{x:.6g}", "m"]
    assert rows["cart rate"] == [f"{v:.6g}", "m/s"]
    assert rows["-Kx x: cart position"] == [f"{position.share:.6g}", "N"]
    assert rows["-Kv v: cart rate"] == [f"{rate.share:.6g}", "N"]
    assert (rows["Kx"], rows["Kv"]) == (["-33.3333", "N/m"], ["-36.1207", "N s/m"])
    assert rows["alpha = Kp^2 / (Ki Kd)"] == ["–"]


def test_a_law_may_feed_back_the_hip_or_only_use_it_or_neither(short_run):
    def at(controller, *settings):
        path = short_run("fig8", controller, settings=settings)
        says = CliRunner().invoke(trunk, ["explain", str(path), "--at", "0.7"]).output
        return explain(RecordedRun.open(path), 0.7), says

    found, says = at("pid")
    assert found.hip == ()
    assert "hip" not in says
    found, says = at("computed_torque")
    assert [part.share for part in found.hip] == [0.0, 0.0]
    assert "hip rate" in says
    assert "Kx" not in says
    found, says = at("state_feedback", "state_feedback.gains.v=2.0")
    assert found.by_model == pytest.approx(found.hip[1].share, abs=1e-12)
    assert re.search(r"  Kv +2 +N m s/m\n", says)
    assert "Kx" not in says
    found, says = at(
        "state_feedback", "state_feedback.gains.v=2.0", "state_feedback.hip_joint=trunk"
    )
    assert [part.unit for part in found.hip] == ["rad", "rad/s"]
    assert re.search(r"  Kv +2 +N m s/rad\n", says)
