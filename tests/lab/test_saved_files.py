"""Random experiments, computed and saved by the page's scripts: files as the project's own runs have them."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from trunk_experiments.plans.plan import RunPlan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import UNJUDGED, VERIFIED, verdict_on
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.parameters.declarations import values_of
from trunk_sim.simulation import DivergedError

from .experiments import ASSETS, Setup, lab_for, plan_with, plans_of, random_setup, refused

MISSING = [tool for tool in ("node", "clang", "wasm-ld") if shutil.which(tool) is None]
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


@pytest.mark.slow
@pytest.mark.skipif(bool(MISSING), reason=f"no {', '.join(MISSING)}")
@pytest.mark.parametrize(("scenario", "law"), [("demo", "pid"), ("fig8", "fuzzy_pid")])
def test_files_saved_in_a_page_are_identical_and_verified(scenario, law, tmp_path):
    plans = plans_of(scenario, ("simulator.duration=2",), (law,))
    lab = lab_for(plans)
    drawn = (random_setup(lab, law, seed) for seed in range(1000))
    setups = list(islice((s for s in drawn if not refused(plans[law], law, s)), COUNT))
    (tmp_path / "lab.json").write_text(json.dumps(lab))
    (tmp_path / "experiments.json").write_text(json.dumps([[law, setup] for setup in setups]))
    script = Path(__file__).parent / "save.mjs"
    subprocess.run(["node", str(script), str(ASSETS), str(tmp_path)], check=True)
    for i, setup in enumerate(setups):
        diverged = False
        try:
            record_offline(expected(plans[law], law, setup), tmp_path / f"{i}_ours.mcap")
        except DivergedError:
            diverged = True
        saved = RecordedRun.open(tmp_path / f"{i}.mcap")
        difference = diff(RecordedRun.open(tmp_path / f"{i}_ours.mcap"), saved)
        assert difference.identical, setup
        assert difference.record == difference.parameters == []
        assert verdict_on(saved).exit_code == (UNJUDGED if diverged else VERIFIED)
