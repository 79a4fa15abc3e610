"""The plans behind a study's runs as plain values, independent of later changes to files.

They are kept in the results' metadata, as JSON (with Python's ``Infinity``), and decide whether an
interrupted sweep may resume.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from trunk_msgs_util.parameters.config import RecorderConfig
from trunk_msgs_util.parameters.declarations import ParameterError, build, values_of

from ..errors import StudyError
from ..plans.nodes import NODES
from ..plans.plan import RunPlan
from .design import drawn_values
from .study import StudySpec, Variable
from .targets import Base, Bases, Key, keys, structural


def plans_json(study: StudySpec, bases: Bases) -> str:
    """Return the plans that a study's runs start from: all parameters of each plan's nodes."""
    return json.dumps([_as_values(study, key, base) for key, base in bases.items()])


def bases_from(study: StudySpec, text: str, source: str) -> Bases:
    """Return the input of `plans_json`. Raises StudyError naming the source."""
    bases: Bases = {}
    try:
        for entry in json.loads(text):
            values = entry["parameters"]
            simulator, disturbance, controller = (
                build(NODES[node].config, values[node])
                for node in ("simulator", "disturbance", entry["node"])
            )
            plan = RunPlan(
                scenario=entry["scenario"],
                simulator=simulator,
                controllers={entry["node"]: controller},
                disturbance=disturbance if disturbance.active else None,
                recorder=RecorderConfig(),
            )
            varied = tuple(entry["varied"][v.name] for v in structural(study))
            bases[entry["controller"], varied] = Base(plan, disturbance)
        if set(bases) != set(keys(study)):
            raise KeyError("plans")
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        reason = error if isinstance(error, ParameterError) else type(error).__name__
        raise StudyError(
            f"{source}: plans that this version does not understand ({reason}): sweep the study again"
        ) from None
    return bases


def identity(study: StudySpec, bases: Bases) -> dict[str, Any]:
    """Return, as JSON values, what determines a sweep's results: no file names, no comments."""
    content = {
        "variables": [_plain(v) for v in study.variables],
        "controllers": [[c.label, c.node] for c in study.contenders],
        "runs": study.runs,
        "seed": study.seed,
        "draws": {name: _hash(values) for name, values in drawn_values(study).items()},
        "block": study.block,
        "plans": [_as_values(study, key, base) for key, base in bases.items()],
    }
    document: dict[str, Any] = json.loads(json.dumps(content))
    return document


def digest(content: Mapping[str, Any]) -> str:
    """Return a hash of an identity."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return in words how blocks of an old identity differ from those of a new one; empty: not at all."""
    for name in ("variables", "controllers", "runs", "seed", "draws", "block"):
        if old.get(name) != new[name]:
            return f"are another study's: its {name} differ{'s' * (name in ('seed', 'block'))}"
    for before, after in zip(old.get("plans", []), new["plans"], strict=False):
        for node, values in after["parameters"].items():
            for name, value in values.items():
                was = before["parameters"].get(node, {}).get(name)
                if was != value:
                    return (
                        "were made with other parameters: "
                        f"{after['controller']}: {node}.{name} was {was}, is now {value}"
                    )
    return "" if old.get("plans") == new["plans"] else "were made with other parameters"


def _plain(v: Variable) -> dict[str, Any]:
    """Return an entry as plain values; in which units it was written makes no difference."""
    return {name: value for name, value in asdict(v).items() if name != "written"}


def _hash(values: list[Any]) -> str:
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()[:16]


def _as_values(study: StudySpec, key: Key, base: Base) -> dict[str, Any]:
    label, varied = key
    plan = base.plan
    return {
        "controller": label,
        "varied": {v.name: value for v, value in zip(structural(study), varied, strict=True)},
        "scenario": plan.scenario,
        "node": plan.controller_name,
        "parameters": {
            "simulator": values_of(plan.simulator),
            "disturbance": values_of(base.disturbance),
            plan.controller_name: values_of(plan.controller),
        },
    }
