"""A lab's runs in Node have the bits of the project's own, whatever is changed, pushed or branched."""

import json
import random
import subprocess
from math import inf

import numpy as np
import pytest

from trunk_core.units import nanoseconds
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import recorded_metrics
from trunk_experiments.lab.webassembly import missing_tools
from trunk_runs.offline_recording import record_offline

from .experiments import (
    ASSETS,
    LAWS,
    NODE,
    equal_bits,
    in_node,
    lab_for,
    plan_with,
    plans_of,
    random_setup,
    refused,
    table_of,
)

pytestmark = [
    pytest.mark.skipif(bool(missing_tools()), reason=missing_tools()),
    pytest.mark.skipif(NODE is None, reason="Node.js: the lab's runs outside of a browser"),
    pytest.mark.slow,
]
NOTHING = {"values": {}, "branch": None, "pushes": []}
NOISE = ("simulator.sensor.position_noise=0.01", "simulator.sensor.velocity_noise=0.05")
CASES = {
    "fig6": (),
    "fig8": (),
    "fig9": (*NOISE, "simulator.fall.stop=true"),
    "demo": ("simulator.sensor.delay=0.01", "simulator.hip.mode=passive"),
}


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=() if name == "fig8" else pytest.mark.one_in(8)) for name in CASES
    ],
)
def case(request):
    plans = plans_of(request.param, CASES[request.param])
    return plans, lab_for(plans)


@pytest.mark.one_in(8)
@pytest.mark.parametrize("block", range(16))
def test_experiments_have_the_bits_of_the_run_that_they_mean(case, block):
    plans, lab = case
    experiments = [(law, random_setup(lab, law, 10 * block + i)) for i in range(2) for law in LAWS]
    experiments += [(law, NOTHING) for law in LAWS]
    for (law, setup), result in zip(experiments, in_node(lab, experiments), strict=True):
        assert ("error" in result) == refused(plans[law], law, setup), result.get("error")
        if "error" not in result:
            table, diverged = table_of(plan_with(plans[law], law, setup))
            assert equal_bits(result["table"], table), (law, setup)
            assert (result["ended"] == "diverged") == diverged


def test_metrics_are_those_of_the_recording(case, tmp_path):
    plans, lab = case
    experiments = [(law, random_setup(lab, law, 1000 + i)) for i, law in enumerate(LAWS)]
    experiments.append(("pid", NOTHING))
    compared = 0
    for i, ((law, setup), result) in enumerate(
        zip(experiments, in_node(lab, experiments), strict=True)
    ):
        if "error" in result or result["ended"] == "diverged":
            continue
        path = tmp_path / f"{i}.mcap"
        record_offline(plan_with(plans[law], law, setup), path)
        expected = {
            name: None if value == inf else value  # as JSON.stringify writes it
            for name, value in recorded_metrics(RecordedRun.open(path)).as_dict().items()
        }
        assert result["metrics"] == {"values": expected, "failure": ""}, (law, setup)
        compared += 1
    assert compared >= 3


def test_what_is_no_knob_is_refused_in_one_line(case):
    _, lab = case
    wrong = {
        "pid": {"gains.p": [-1.0, "x", None, [1.0], 1e300, "inf"], "u_clamp_max": [-1.0]},
        "simulator": {"update_rate": [100.0], "nothing": [1.0], "substeps": [1.5, 0]},
        "nobody": {"gains.p": [1.0]},
    }
    experiments = [
        ("pid", {**NOTHING, "values": {node: {name: value}}})
        for node, names in wrong.items()
        for name, values in names.items()
        for value in values
    ]
    late = {"at_ns": 0, "values": {"simulator": {"initial.position": [0.0, 0.1]}}}
    experiments.append(("pid", {**NOTHING, "branch": late}))
    rows = lab["nodes"]["fuzzy_pid"]["parameters"]["rules.kp"]
    for rules in (rows[:-1], [*rows[:-1], "S S"], [rows[0].replace("B", "Q"), *rows[1:]], "B"):
        experiments.append(("fuzzy_pid", {**NOTHING, "values": {"fuzzy_pid": {"rules.kp": rules}}}))
    for (_, setup), result in zip(experiments, in_node(lab, experiments), strict=True):
        assert "error" in result, setup
        assert len(result["error"].splitlines()) == 1


def test_a_push_by_hand_acts_until_the_next_or_the_timeout(case):
    plans, lab = case
    period = lab["period_ns"]
    setup = {**NOTHING, "pushes": [[10 * period, 0.0, 30.0], [20 * period, 0.0, 0.0]]}
    for result in in_node(lab, [("pid", setup)]):
        table, _ = table_of(plan_with(plans["pid"], "pid", setup))
        undisturbed, _ = table_of(plans["pid"])
        assert equal_bits(result["table"], table)
        first = int(np.flatnonzero((table != undisturbed).any(axis=1))[0])
        assert first == 11


def test_seconds_become_the_nanoseconds_of_python():
    rng = random.Random(1)
    values = [rng.uniform(0.0, 10.0) for _ in range(500)]
    values += [k * 1e-9 + half for k in range(20) for half in (0.5e-9, 2.0**-31)]
    script = f"{(ASSETS / 'engine.js').read_text()}\n"
    script += (
        f"console.log(JSON.stringify({json.dumps(values)}.map((v) => String(nanoseconds(v)))))"
    )
    done = subprocess.run([NODE, "-e", script], capture_output=True, text=True, check=True)
    assert list(map(int, json.loads(done.stdout))) == list(map(nanoseconds, values))


def test_a_file_for_some_of_the_controllers_is_theirs(trunk, tmp_path):
    files = {name: tmp_path / f"{name}.yaml" for name in ("pid", "fuzzy_pid", "fuzzy")}
    for name, path in files.items():
        path.write_text(f"{name}: {{ros__parameters: {{u_clamp_max: 90.0}}}}\n")
    given = [word for path in files.values() for word in ("--params", path)]
    code, said, warned = trunk("lab", "fig8", *given, "-o", tmp_path / "lab.html", "--json")
    assert code == 0, warned
    commands = json.loads(said)["commands"]
    for name, other in (("pid", "fuzzy_pid"), ("fuzzy_pid", "pid")):
        assert str(files[name]) in commands[name]
        assert str(files[other]) not in commands[name]
    lines = warned.splitlines()
    assert len(lines) == 2, warned
    assert all("fuzzy.yaml: no node of this run uses anything in it" in line for line in lines)
