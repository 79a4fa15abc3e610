"""Experiments that a page saves: `trunk simulate --like` records them, and compares the bits."""

import csv
import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from trunk_core import topics
from trunk_core.parameters.declarations import declarations, values_of
from trunk_evidence.differences import diff
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.lab.experiment import (
    FORMAT,
    NO_LINKS,
    Experiment,
    read_experiment,
    record_experiment,
)
from trunk_experiments.lab.knobs import KnobSearch, with_value
from trunk_experiments.lab.webassembly import NAMES, values_of_loop
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.timeline import Change
from trunk_sim.config import TrunkSimulator
from trunk_sim.simulation import DivergedError

from .experiments import ASSETS, Setup, lab_for, plan_with, plans_of, random_setup, refused

COUNT = 3
NOTHING: Setup = {"values": {}, "branch": None, "pushes": []}


def expected(plan: RunPlan, law: str, setup: Setup) -> RunPlan:
    """Return an experiment's plan as `trunk simulate` and `trunk branch` make it: without what stays."""
    made = plan_with(plan, law, setup)
    changes = {}
    for node, (change,) in made.changes.items():
        present = values_of(made.configs[node])
        changed = {n: v for n, v in (change.values or {}).items() if v != present[n]}
        changes |= {node: [Change(change.stamp_ns, changed)]} if changed else {}
    return replace(made, changes=changes)


def saved(
    plans: Mapping[str, RunPlan], law: str, setups: Sequence[Setup], folder: Path
) -> list[Path]:
    """Return the files of experiments that a page saves."""
    (folder / "lab.json").write_text(json.dumps(lab_for(plans)))
    (folder / "experiments.json").write_text(json.dumps([[law, setup] for setup in setups]))
    script = Path(__file__).parent / "save.mjs"
    subprocess.run(["node", str(script), str(ASSETS), str(folder)], check=True)
    return [folder / f"{i}.json" for i in range(len(setups))]


def compare(plans: Mapping[str, RunPlan], law: str, setups: Sequence[Setup], folder: Path) -> int:
    """Assert that saved experiments are recorded as what they mean; return how many diverged."""
    diverging = 0
    for i, path in enumerate(saved(plans, law, setups, folder)):
        setup, outcome = setups[i], VERIFIED
        experiment = read_experiment(path)
        states, diverged, difference = record_experiment(experiment, folder / f"{i}.mcap")
        assert (states, difference) == (experiment.states, ""), setup
        assert len(experiment.sha256) == 64
        made = RecordedRun.open(folder / f"{i}.mcap")
        last_ns = int(made.table(topics.GROUND_TRUTH).stamp_ns.max())
        if setup["branch"] and setup["branch"]["at_ns"] > last_ns:  # it has fallen before that
            setup = {**setup, "branch": None}
        try:
            record_offline(expected(plans[law], law, setup), folder / f"{i}_ours.mcap")
        except DivergedError:
            outcome = UNJUDGED
            diverging += 1
        assert (diverged is not None) == (outcome == UNJUDGED)
        ours = RecordedRun.open(folder / f"{i}_ours.mcap")
        compared = diff(ours, made)
        assert compared.identical, setup
        assert compared.record == compared.parameters == [], setup
        assert made.recording.end == ours.recording.end
        assert verdict_on(made).exit_code == outcome
        check_states(folder / f"{i}.csv", made)
    return diverging


def check_states(path: Path, run: RecordedRun) -> None:
    """Assert that the states that a page saves as CSV are those of a run, with all digits."""
    with path.open(newline="") as file:
        heads, *rows = csv.reader(file)
    truth = run.table(topics.GROUND_TRUTH)
    assert heads[: len(NAMES) + 1] == ["t", *NAMES]
    numbers = np.array([row[:5] for row in rows], np.float64)
    assert np.array_equal(np.round(numbers[:, 0] * 1e9).astype(np.int64), truth.stamp_ns)
    assert np.array_equal(numbers[:, 1:], np.hstack([truth.position, truth.velocity]))


@pytest.mark.one_in(2)
@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "law"), [("demo", "pid"), ("fig8", "fuzzy_pid")])
@pytest.mark.usefixtures("tools")
def test_saved_experiments_are_recorded_with_the_same_bits(scenario, law, tmp_path):
    plans = plans_of(scenario, ("simulator.duration=2",), (law,))
    lab = lab_for(plans)
    drawn = (random_setup(lab, law, seed) for seed in range(1000))
    setups = list(islice((s for s in drawn if not refused(plans[law], law, s)), COUNT))
    compare(plans, law, setups, tmp_path)


@pytest.mark.usefixtures("tools")
def test_a_diverging_run_is_recorded_as_one(tmp_path):
    rates = ("simulator.update_rate=200", "pid.update_rate=200", "simulator.duration=1")
    unstable = {**NOTHING, "values": {"pid": {"gains.d": 900.0}}}
    assert compare(plans_of("fig6", rates, ("pid",)), "pid", [unstable], tmp_path) == 1


@pytest.mark.usefixtures("tools")
def test_a_disturbance_begins_with_a_branch(tmp_path):
    """One that is zero at the start is no node until then, as in `trunk branch`."""
    plans = plans_of("fig8", ("simulator.duration=0.6",), ("pid",))
    quiet = {"pulse.magnitude": 0.0, "pulse.start_times": [0.2, 0.4]}
    branch = {"at_ns": 300_000_000, "values": {"disturbance": {"pulse.magnitude": 0.5}}}
    setup = {"values": {"disturbance": quiet}, "branch": branch, "pushes": []}
    (path,) = saved(plans, "pid", [setup], tmp_path)
    plan = read_experiment(path).plan
    assert plan.disturbed_ns == 300_000_000
    assert "disturbance" not in plan.simulator.wait_for
    assert record_experiment(read_experiment(path), tmp_path / "run.mcap")[2] == ""
    run = RecordedRun.open(tmp_path / "run.mcap")
    assert run.table(topics.DISTURBANCE).stamp_ns[0] == 300_000_000
    assert verdict_on(run).exit_code == VERIFIED


@pytest.fixture
def document(tmp_path):
    """Return a small experiment as a page would save it, with pushes and a branch."""
    everywhere = {"duration": 0.2, "operator.torque": 30.0, "operator.force": 50.0}
    plan = make_plan("fig8", "pid", everywhere=everywhere)
    listed = {node: values_of(config) for node, config in plan.configs.items()}
    data = {
        "format": FORMAT,
        "scenario": "mine",
        "controller": "pid",
        "page": "0123456789abcdef",
        "parameters": {node: listed[node] for node in ("simulator", "disturbance", "pid")},
        "values": {"fuzzy_pid": {"gains.p_max": 75.0}},
        "branch": {"at_ns": 100_000_000, "values": {"pid": {"gains.p": 75.0}}},
        "pushes": [[0, -10.5, 0.0], [50_000_000, 0.0, 30.0]],
        "states": 201,
        "sha256": None,
    }
    text = json.dumps(data).replace("Infinity", '"inf"')
    return json.loads(text.replace('-"inf"', '"-inf"'))


def test_the_verb_says_whether_the_bits_are_those_of_the_browser(document, trunk, tmp_path):
    path, run = tmp_path / "experiment.json", tmp_path / "experiment.mcap"
    for sha256, states, code, words in (
        (None, 201, 0, "the browser took no digest, so that the bits are not compared"),
        ("0" * 64, 201, 1, "DIFFERS: its 201 states, SHA-256 "),
        (None, 200, 1, "DIFFERS: "),
    ):
        path.write_text(json.dumps({**document, "sha256": sha256, "states": states}))
        found, said, _ = trunk("simulate", "--like", path, "-o", run, "--force")
        assert (found, words in said) == (code, True), said
        assert trunk("verify", run)[0] == VERIFIED
        as_json = json.loads(trunk("simulate", "--like", path, "-o", run, "--force", "--json")[1])
        assert as_json["same_bits"] is (False if code else None)
    digest = said.partition("SHA-256 ")[2][:12]
    experiment = Experiment(read_experiment(path).plan, 201, "", "")
    assert record_experiment(experiment, run, overwrite=True)[2] == ""
    assert len(digest) == 12
    assert "pushes" not in trunk("info", run)[1]
    assert "operator/push" in trunk("info", run)[1]


def test_what_a_lab_lacks_is_the_reason_why_it_is_refused(trunk, tmp_path):
    page = tmp_path / "lab.html"
    names = [name for name in declarations(TrunkSimulator) if name.startswith("link.")]
    assert len(names) > 10
    refused = KnobSearch(make_plan("demo", "pid")).of("simulator").refused
    assert {refused[name] for name in (*names, "sensor.dropout")} == {NO_LINKS}
    for name in ("link.command.loss", "sensor.dropout"):
        code, _, err = trunk("lab", "demo", "--set", f"simulator.{name}=0.1", "-o", page)
        assert (code, len(err.splitlines())) == (2, 1)
        assert err.endswith(f"{NO_LINKS}: leave out link.* and sensor.dropout\n")


def test_a_knob_takes_no_value_that_changes_other_numbers():
    """A negative upper limit is also the command that a controller begins with."""
    plan = make_plan("demo", "pid")
    knob = KnobSearch(plan).of("pid").knobs["u_clamp_max"]
    changes = {}
    for value in (-50.0, 50.0):
        after = values_of_loop(with_value(plan, "pid", "u_clamp_max", value))
        changes[value] = sum(
            old != new for old, new in zip(values_of_loop(plan), after, strict=True)
        )
    assert changes == {-50.0: 3, 50.0: len(knob.places)}
    assert knob.low == 0.0


def test_a_wrong_branch_is_named_as_the_files(document, trunk, tmp_path):
    path = tmp_path / "experiment.json"
    document["branch"]["values"] = {"simulator": {"duration": 0.3}}
    path.write_text(json.dumps(document))
    _, _, err = trunk("simulate", "--like", path, "-o", tmp_path / "run.mcap")
    assert "a lab saved: branch simulator.duration: it is fixed when a run starts" in err
    assert "--" not in err


WRONG = (None, 7, -1.5, "x", [], {}, [[1, 2]], True)


def test_what_no_page_saves_is_refused_in_one_line(document, trunk, tmp_path):
    path = tmp_path / "experiment.json"
    damaged = [{k: v for k, v in document.items() if k != key} for key in document]
    damaged += [{**document, "more": 1}, [], 7, "x"]
    allowed = {
        "values": [{}],
        "branch": [None],
        "pushes": [[]],
        "sha256": [None, "x"],
        "scenario": ["x"],
    }
    allowed |= {"page": ["x"], "states": [7]}
    damaged += [
        {**document, key: value}
        for key in document
        for value in WRONG
        if not any(
            value is each or (value == each and value is not True) for each in allowed.get(key, [])
        )
    ]
    changed = json.dumps(document)
    damaged += [
        json.loads(changed.replace(old, new))
        for old, new in (
            ('"gains.p": 75.0', '"gains.q": 75.0'),
            ('"gains.p": 75.0', '"gains.p": "75"'),
            ('"gains.p": 75.0', '"gains.p": -1'),
            ('"gains.p": 75.0', '"update_rate": 100.0'),
            ("100000000", "100000001"),
            ("50000000, 0.0, 30.0", "50000000, 0.0, 31.0"),
            ("50000000, 0.0, 30.0", "0, 0.0, 30.0"),
            ("50000000, 0.0, 30.0", "50000000, 0.0"),
            ("50000000, 0.0, 30.0", "50000000, null, 30.0"),
            ("50000000, 0.0, 30.0", '50000000, "0", 30.0'),
            ("50000000, 0.0, 30.0", f"50000000, 1{400 * '0'}, 30.0"),
            ("50000000, 0.0, 30.0", "500000000, 0.0, 30.0"),
            ("100000000", f"{5 * 10**36}"),
            ('{"pid": {"gains.p": 75.0}}', '{"disturbance": 5}'),
            ('{"fuzzy_pid": {"gains.p_max"', '{"pid": {"gains.q"'),
            ('{"gains.p_max": 75.0}', "5"),
            ('"scenario": "mine"', '"scenario": "fig8\\nverified"'),
            ('"scenario": "mine"', '"scenario": "\\ud800"'),
            ('"scenario": "mine"', f'"scenario": "{1000 * "x"}"'),
            ('"duration": 0.2', '"duration": 1e6'),
            ('"link.command.delay": 0.0', '"link.command.delay": 0.01'),
        )
    ]
    for data in damaged:
        path.write_text(json.dumps(data))
        code, out, err = trunk("simulate", "--like", path, "-o", tmp_path / "run.mcap")
        assert (code, out, len(err.splitlines())) == (2, "", 1), (data, err)
        assert not (tmp_path / "run.mcap").exists()
    for text in ("", "{", "[" * 100_000, "\0"):
        path.write_text(text)
        code, _, err = trunk("simulate", "--like", path, "-o", tmp_path / "run.mcap")
        assert (code, len(err.splitlines())) == (2, 1)
