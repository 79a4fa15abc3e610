"""Labs, each made once; random experiments of one, and the runs that they mean to CPython and numba."""

import json
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from hashlib import blake2b
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from ros2_ws.src.trunk_core.test.c_programs import made_once

from trunk_core.parameters.declarations import ParameterError, build, values_of
from trunk_experiments.commands.lab import command
from trunk_experiments.console.options import HAND
from trunk_experiments.lab import webassembly
from trunk_experiments.lab.data import lab_of
from trunk_runs.engine import FRESH, TERMS, Engine
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.timeline import Change
from trunk_sim.inputs import Applied
from trunk_sim.simulation import DivergedError

Setup = dict[str, Any]
LAWS = ("pid", "fuzzy_pid", "lqr", "computed_torque")
NODE = shutil.which("node")
HERE = Path(__file__).parent
ASSETS = Path(str(files("trunk_experiments"))) / "lab" / "assets"


def plans_of(
    scenario: str, settings: Sequence[str] = (), laws: Sequence[str] = LAWS
) -> dict[str, RunPlan]:
    """Return a scenario's plans, one for each law."""
    return {law: make_plan(scenario, law, (), settings, {}, below=HAND) for law in laws}


@cache
def _made_of() -> str:
    """Return a digest of all that makes a lab: the packages' files, the compiler, Python."""
    digest = blake2b(sys.version.encode())
    packages = HERE.parents[1] / "ros2_ws" / "src"
    for path in sorted(packages.glob("trunk_*/**/*")):
        place = path.relative_to(packages)
        if path.is_file() and not {"test", "__pycache__"} & set(place.parts):
            digest.update(f"{place}\0".encode() + path.read_bytes())
    linker = ["wasm-ld"] if shutil.which("wasm-ld") else [*webassembly._compiler()]
    for tool in (webassembly._compiler(), linker):
        digest.update(subprocess.check_output([*tool, "--version"]))
    for library in ("jinja2", "ziglang"):
        with suppress(PackageNotFoundError):
            digest.update(version(library).encode())
    return digest.hexdigest()


def lab_for(plans: Mapping[str, RunPlan]) -> dict[str, Any]:
    """Return the data of a lab as its page has them."""
    commands = {law: ["trunk", "simulate", plan.scenario] for law, plan in plans.items()}
    of = "data", _made_of(), plans, commands
    data: dict[str, Any] = json.loads(
        made_once(of, lambda: json.dumps(lab_of(plans, commands)).encode())
    )
    return data


def page_of(*words: str) -> bytes:
    """Return the page that `trunk lab` writes."""

    def made() -> bytes:
        with tempfile.TemporaryDirectory(prefix="trunk-lab-") as folder:
            path = Path(folder, "lab.html")
            done = CliRunner().invoke(command, [*words, "-o", str(path)], catch_exceptions=False)
            assert done.exit_code == 0, done.output
            return path.read_bytes()

    return made_once(("page", _made_of(), words), made)


def random_setup(lab: Mapping[str, Any], law: str, seed: int) -> Setup:
    """Return an experiment: some knobs, rules, pushes by hand, a branch."""
    rng = random.Random(seed)
    setup: Setup = {"values": _values(lab, law, rng), "branch": None, "pushes": []}
    period, end = lab["period_ns"], lab["states"]
    if rng.random() < 0.5:
        values = {
            node: {n: v for n, v in changed.items() if not lab["declared"][node][n]["start"]}
            for node, changed in _values(lab, law, rng).items()
        }
        setup["branch"] = {"at_ns": rng.randrange(end) * period, "values": values}
    if rng.random() < 0.5:
        stamps = sorted(rng.sample(range(end), rng.randint(1, 20)))
        setup["pushes"] = [
            [k * period, rng.choice([0.0, rng.uniform(-100, 100)]), rng.uniform(-40, 40)]
            for k in stamps
        ]
    return setup


def _values(lab: Mapping[str, Any], law: str, rng: random.Random) -> dict[str, dict[str, Any]]:
    values: dict[str, dict[str, Any]] = {}
    for node in ("simulator", "disturbance", law):
        for name, knob in lab["knobs"].get(node, {}).items():
            if rng.random() > 0.15 or name == "substeps":
                continue
            now = lab["nodes"][node]["parameters"][name]
            if "labels" in knob:
                labels = list(knob["labels"])
                value: Any = [
                    " ".join(
                        cell if rng.random() < 0.9 else rng.choice(labels) for cell in row.split()
                    )
                    for row in now
                ]
            elif knob["kind"] == "seed":
                value = rng.randrange(2**31)
            elif knob["array"]:
                value = [_number(knob, item, rng) for item in now]
            else:
                value = _number(knob, now, rng)
            values.setdefault(node, {})[name] = value
    return values


def _number(knob: Mapping[str, Any], now: Any, rng: random.Random) -> Any:
    low, high = float(knob["low"]), float(knob["high"])
    about = float(now)
    size = abs(about) if about and np.isfinite(about) else rng.choice([0.01, 1.0, 50.0])
    value = size * rng.choice([rng.uniform(0.5, 1.5), 10 ** rng.uniform(-2, 1)])
    value = max(low, min(value * (rng.choice([-1, 1]) if low < 0 else 1), high))
    return int(value) if knob["kind"] == "integer" else value


def plan_with(plan: RunPlan, law: str, setup: Setup) -> RunPlan:
    """Return the plan that an experiment means. Raises ParameterError for values that are not allowed."""
    changed = plan
    for node, values in setup["values"].items():
        changed = _with(changed, node, values)
    changes: dict[str, tuple[Change, ...]] = {}
    if branch := setup["branch"]:
        at_ns = branch["at_ns"]
        before_ns = at_ns - plan.simulator.period_ns if at_ns else -1
        for node, values in branch["values"].items():
            if not values:
                continue
            stamp = at_ns if node == "simulator" else before_ns
            whole = {name: _value(value) for name, value in values.items()}
            _with(changed, node, values)
            changes[node] = (Change(stamp, whole),)
    pushes = tuple((stamp, Applied(force, torque)) for stamp, force, torque in setup["pushes"])
    return replace(changed, changes=changes, pushes=pushes)


def _with(plan: RunPlan, node: str, values: Mapping[str, Any]) -> RunPlan:
    config = plan.configs[node]
    built = build(type(config), {**values_of(config), **{n: _value(v) for n, v in values.items()}})
    if node in plan.controllers:
        return replace(plan, controllers={**plan.controllers, node: built})
    return replace(plan, **{node: built})


def _value(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_value(item) for item in value)
    return float(value) if value in ("inf", "-inf") else value


def table_of(plan: RunPlan) -> tuple[Any, bool]:
    """Return all columns of a plan's states, and whether it diverged."""
    parts: list[Any] = []
    try:
        for states in Engine(plan, compiled=True).states():
            parts.append(states.table.copy())
    except DivergedError:
        return np.vstack(parts), True
    return np.vstack(parts), False


def in_node(
    lab: Mapping[str, Any], experiments: Sequence[tuple[str, Setup]]
) -> list[dict[str, Any]]:
    """Return what the lab's engines compute in Node: numbers, and the table as ``table``."""
    with tempfile.TemporaryDirectory(prefix="trunk-lab-") as folder:
        place = Path(folder)
        (place / "lab.json").write_text(json.dumps(lab))
        (place / "experiments.json").write_text(json.dumps(experiments))
        command = [str(NODE), str(HERE / "run.mjs"), str(ASSETS), folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        results: list[dict[str, Any]] = json.loads(done.stdout)
        numbers = np.fromfile(place / "tables.bin")
    at = 0
    for result in results:
        size = result.get("count", 0) * result.get("width", 0)
        if size:
            result["table"] = numbers[at : at + size].reshape(-1, result["width"])
        at += size
    return results


def in_page(evaluate: Callable[[str], Any], experiments: Sequence[tuple[str, Setup]]) -> list[str]:
    """Return the bits of experiments as a page computes them; ``evaluate`` evaluates in it."""
    evaluate(
        f"(globalThis.bitsOf = (() => {{ {(HERE / 'bits.js').read_text()}; return bitsOf; }})(), 0)"
    )
    evaluate(
        "(async () => { globalThis.engines = {}; for (const name of lab.controllers) "
        "engines[name] = await openEngine(lab, name); return 0; })()"
    )
    results: list[str] = []
    for first in range(0, len(experiments), 20):
        part = json.dumps(experiments[first : first + 20])
        results += evaluate(f"{part}.map(([name, setup]) => bitsOf(engines[name], setup))")
    return results


def equal_bits(table: Any, expected: Any) -> bool:
    """Return whether a lab's table has the bits of a run's: terms only where the law was updated."""
    width = expected.shape[1]
    if len(table) != len(expected):
        return False
    ours, theirs = (np.ascontiguousarray(t[:, :width]) for t in (table, expected))
    same = (ours.view(np.int64) == theirs.view(np.int64)) | (np.isnan(ours) & np.isnan(theirs))
    fresh = theirs[:, FRESH] == 1.0
    return bool(same[:, :TERMS].all() and same[fresh].all())


def refused(plan: RunPlan, law: str, setup: Setup) -> bool:
    """Return whether the project refuses an experiment's values."""
    try:
        plan_with(plan, law, setup)
    except ParameterError:
        return True
    return False
