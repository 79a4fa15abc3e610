"""A plan's run, computed here and recorded as a page records it, in Node."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import trunk_experiments.lab as lab_package
from trunk_experiments.gateway.protocol import plain
from trunk_experiments.lab.data import recording_template
from trunk_experiments.plans.plan import RunPlan
from trunk_experiments.runs.engine import Engine
from trunk_experiments.runs.loop_inputs import disturbance_source, states_of
from trunk_experiments.runs.states import States
from trunk_msgs_util.parameters.declarations import declarations, values_of
from trunk_sim.simulation import DivergedError

HERE = Path(__file__).parent
ASSETS = Path(str(lab_package.__file__)).parent / "assets"
DIGEST = "0123456789abcdef" * 4

needs_node = pytest.mark.skipif(
    shutil.which("node") is None, reason="no node: apt-get install nodejs"
)


class Computed(NamedTuple):
    """A run's states as an engine in the page has them."""

    states: list[States]
    ended: str
    reason: str
    ahead: tuple[float, ...]


def computed(plan: RunPlan) -> Computed:
    """Return a plan's run."""
    states: list[States] = []
    ended = reason = ""
    try:
        states += Engine(plan).states()
    except DivergedError as error:
        ended, reason = "diverged", str(error)
    count = sum(len(part.table) for part in states)
    if not ended and count < states_of(plan):
        ended = "fell"
    acting = disturbance_source(plan)
    return Computed(states, ended, reason, tuple(acting(count * plan.simulator.period_ns)))


def page_recording(
    plan: RunPlan, run: Computed, folder: Path, setup: Mapping[str, Any] = {}
) -> Path:
    """Return the file that a page with this plan writes of a run with this setup."""
    (name,) = plan.controllers
    table = np.concatenate([part.table for part in run.states])
    table.tofile(folder / "table")
    lab = {
        "period_ns": plan.simulator.period_ns,
        "states": states_of(plan),
        "digest": DIGEST,
        "recording": recording_template({name: plan}),
        "nodes": {
            node: {"parameters": {n: plain(v) for n, v in values_of(config).items()}}
            for node, config in plan.configs.items()
        },
        "declared": {
            node: {
                d.name: {"kind": d.kind, "default": plain(d.default)}
                for d in declarations(type(config)).values()
            }
            for node, config in plan.configs.items()
        },
    }
    values = {
        "width": table.shape[1],
        "count": len(table),
        "ended": run.ended,
        "reason": run.reason,
        "falls": [part.first + row for part in run.states for row in part.falls],
        "ahead": run.ahead,
        "setup": {"values": {}, "branch": None, "pushes": [], **setup},
    }
    output = folder / "page.mcap"
    files = {"table": str(folder / "table"), "output": str(output)}
    job = folder / "job.json"
    job.write_text(json.dumps({"lab": lab, "name": name, "run": values, **files}, allow_nan=False))
    subprocess.run(["node", str(HERE / "record.mjs"), str(ASSETS), str(job)], check=True)
    return output


def differences(base: RunPlan, plan: RunPlan) -> dict[str, dict[str, Any]]:
    """Return the values of a plan that another one does not have, as a page's setup has them."""
    changed = {
        node: {
            name: plain(value)
            for name, value in values_of(config).items()
            if value != values_of(base.configs[node])[name]
        }
        for node, config in plan.configs.items()
        if node != "recorder"
    }
    return {node: values for node, values in changed.items() if values}
