"""Random experiments, computed and saved by the page's scripts: files as the project's own runs have them."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from trunk_experiments.lab.wasm import missing_tools
from trunk_experiments.plans.plan import RunPlan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import UNJUDGED, VERIFIED, verdict_on
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import values_of
from trunk_sim.simulation import DivergedError

from .experiments import ASSETS, NODE, Setup, lab_for, plan_with, plans_of, random_setup, refused

pytestmark = [
    pytest.mark.skipif(bool(missing_tools()), reason=missing_tools()),
    pytest.mark.skipif(NODE is None, reason="no node: apt-get install nodejs"),
]
COUNT = 3


def expected(plan: RunPlan, law: str, setup: Setup) -> RunPlan:
    """Return an experiment's plan as `trunk simulate` and `trunk branch` make it: without what stays."""
    made = plan_with(plan, law, setup)
    changes = {}
    for node, (change,) in made.changes.items():
        present = values_of(made.configs[node])
        changed = {n: v for n, v in (change.values or {}).items() if v != present[n]}
        changes |= {node: [Change(change.stamp_ns, changed)]} if changed else {}
    return replace(made, changes=changes)


def compare(plans: Mapping[str, RunPlan], law: str, setups: Sequence[Setup], folder: Path) -> int:
    """Assert that files saved in a page are identical and judged as they should; return how many diverged."""
    (folder / "lab.json").write_text(json.dumps(lab_for(plans)))
    (folder / "experiments.json").write_text(json.dumps([[law, setup] for setup in setups]))
    script = Path(__file__).parent / "save.mjs"
    subprocess.run(["node", str(script), str(ASSETS), str(folder)], check=True)
    diverging = 0
    for i, setup in enumerate(setups):
        outcome = VERIFIED
        saved = RecordedRun.open(folder / f"{i}.mcap")
        last_ns = int(saved.table(topics.GROUND_TRUTH).stamp_ns.max())
        if setup["branch"] and setup["branch"]["at_ns"] > last_ns:  # it has fallen before that
            setup = {**setup, "branch": None}
        try:
            record_offline(expected(plans[law], law, setup), folder / f"{i}_ours.mcap")
        except DivergedError:
            outcome = UNJUDGED
            diverging += 1
        ours = RecordedRun.open(folder / f"{i}_ours.mcap")
        difference = diff(ours, saved)
        assert difference.identical, setup
        assert difference.record == difference.parameters == [], setup
        assert saved.recording.end == ours.recording.end
        assert verdict_on(saved).exit_code == outcome
    return diverging


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "law"), [("demo", "pid"), ("fig8", "fuzzy_pid")])
def test_files_saved_in_a_page_are_identical_and_verified(scenario, law, tmp_path):
    plans = plans_of(scenario, ("simulator.duration=2",), (law,))
    lab = lab_for(plans)
    drawn = (random_setup(lab, law, seed) for seed in range(1000))
    setups = list(islice((s for s in drawn if not refused(plans[law], law, s)), COUNT))
    compare(plans, law, setups, tmp_path)


def test_a_diverging_run_names_the_same_reason(tmp_path):
    rates = ("simulator.update_rate=200", "pid.update_rate=200", "simulator.duration=1")
    unstable = {"values": {"pid": {"gains.d": 900.0}}, "branch": None, "pushes": []}
    assert compare(plans_of("fig6", rates, ("pid",)), "pid", [unstable], tmp_path) == 1
