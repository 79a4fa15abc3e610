"""What a lab's page holds as data: scenario, nodes and parameters, knobs, and each controller's program."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2.utils import htmlsafe_json_dumps

from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import declarations, values_of
from trunk_core.units import NANOSECONDS, nanoseconds
from trunk_evidence.run_metrics import QUANTITIES
from trunk_msgs_util.picture.frames import as_data
from trunk_msgs_util.picture.shapes import picture_of
from trunk_runs.engine import TERMS
from trunk_runs.loop import states_of
from trunk_runs.plan import RunPlan
from trunk_sim.disturbances import Disturbance
from trunk_views.live.feed import Board, plain
from trunk_views.live.graph_state import Graph
from trunk_views.parts.page import STYLES, inline, page, part, policy, scripts, write_page
from trunk_views.report_data import channel_texts

from .experiment import FORMAT, check_plan
from .knobs import Knob, KnobSearch, NodeKnobs, RuleKnob
from .webassembly import CHUNK, LabProgram, numbers_of_loop, wasm_of

_NOISE = ("surroundings.sensor.position_noise", "surroundings.sensor.velocity_noise")
_NOT_SHOWN = ("recorder",)


def lab_of(
    plans: Mapping[str, RunPlan],
    commands: Mapping[str, Sequence[str]],
    chosen: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the data of a lab: by controller, a plan with it alone, and the words of its command.

    ``chosen``: NODE.PARAM of the knobs; none: all parameters that can be knobs are.
    Raises PlanError for what a lab cannot compute, UntranslatableError for a law outside of the subset.
    """
    for plan in plans.values():
        check_plan(plan)
    first = next(iter(plans.values()))
    knobs: dict[str, NodeKnobs] = {}
    for name, plan in plans.items():
        search = KnobSearch(plan)
        for node in plan.configs:
            if node not in knobs and node not in _NOT_SHOWN:
                knobs[node] = search.of(node)
        _check_places(first, plan, name)
    if chosen:
        _choose(knobs, chosen)
    programs = {}
    for name, plan in plans.items():
        program = LabProgram(plan, name)
        module = wasm_of(program.text, program.exports)
        programs[name] = {"wasm": _packed(module), "columns": program.columns}
    places = [number.place for number in numbers_of_loop(first) if number.place]
    simulator = first.simulator
    words = simulator.kind.of_drive
    limits = simulator.operator_limits
    return {
        "version": version(__package__.partition(".")[0].replace("_", "-")),
        "scenario": first.scenario,
        "period_ns": simulator.period_ns,
        "states": states_of(first),
        "end_s": (states_of(first) - 1) * simulator.period_ns / NANOSECONDS,
        "controllers": list(plans),
        "chunk": CHUNK,
        "metrics": list(QUANTITIES),
        "quantities": {
            key: [words(text.label), words(text.unit), text.ranked, words(text.meaning)]
            for key, text in QUANTITIES.items()
        },
        "channels": [
            [column, *text]
            for column, text in zip(
                Disturbance._fields, channel_texts(simulator.kind).values(), strict=True
            )
        ],
        "noise": [places.index(place) for place in _NOISE],
        "operator_timeout_ns": nanoseconds(simulator.operator_timeout) if limits else 0,
        **_words(plans, knobs),
        "picture": as_data(picture_of(values_of(simulator))[0]),
        "knobs": {
            node: {
                name: _knob_data(plans, node, name, knob) for name, knob in node_knobs.knobs.items()
            }
            for node, node_knobs in knobs.items()
        },
        "orders": {
            node: [vars(order) for order in node_knobs.orders] for node, node_knobs in knobs.items()
        },
        "commands": {name: list(words) for name, words in commands.items()},
        "experiment": {"format": FORMAT, "columns": TERMS},
        "programs": programs,
    }


def _choose(knobs: Mapping[str, NodeKnobs], chosen: Sequence[str]) -> None:
    """Leave only the chosen knobs. Raises PlanError for one that cannot be."""
    for text in chosen:
        node, _, name = text.partition(".")
        if node not in knobs:
            raise PlanError(
                f"--knob {text}: NODE.PARAM, with a node of {', '.join(knobs)}, is needed"
            )
        if name not in knobs[node].knobs:
            reason = knobs[node].refused.get(name, "there is no such parameter")
            others = ", ".join(f"{node}.{other}" for other in knobs[node].knobs)
            raise PlanError(f"--knob {text}: {reason}; knobs can be {others}")
    for node, node_knobs in knobs.items():
        for name in [name for name in node_knobs.knobs if f"{node}.{name}" not in chosen]:
            del node_knobs.knobs[name]
            node_knobs.refused[name] = "not chosen"
        node_knobs.orders = [
            order
            for order in node_knobs.orders
            if {order.less, order.more} & node_knobs.knobs.keys()
        ]


def _config_of(plans: Mapping[str, RunPlan], node: str) -> Any:
    return next(plan.configs[node] for plan in plans.values() if node in plan.configs)


def _words(plans: Mapping[str, RunPlan], knobs: Mapping[str, NodeKnobs]) -> dict[str, Any]:
    """Return the gateway's messages about the nodes: ``world``, ``nodes``, ``declared``."""
    board = Board()
    graph = Graph(board)
    for node in knobs:
        graph.parameters(node, values_of(_config_of(plans, node)))
    said = [json.loads(text) for text in board.texts()]
    data: dict[str, Any] = {"nodes": {}, "declared": {}}
    for piece in said:
        kind = piece.pop("kind")
        if kind == "world":
            data["world"] = piece
        elif kind == "node":
            data["nodes"][piece["name"]] = piece
        elif kind == "declared":
            data["declared"][piece["name"]] = piece["parameters"]
    places = {name: _states(plan) for name, plan in plans.items()}
    for node, node_knobs in knobs.items():
        states = places.get(node, next(iter(places.values())))
        for name, declared in data["declared"][node].items():
            knob = node_knobs.knobs.get(name)
            at_start = isinstance(knob, Knob) and any(
                place in states for group in knob.places for place in group
            )
            declared["refused"] = node_knobs.refused.get(name, "")
            declared["start"] = bool(declared["fixed"]) or at_start
            declared["fixed"] = knob is None
    return data


def _states(plan: RunPlan) -> set[int]:
    """Return the places of numbers that a run changes itself."""
    places = [number.place for number in numbers_of_loop(plan) if number.place]
    return {i for i, place in enumerate(places) if place.startswith("state.")}


def _check_places(first: RunPlan, plan: RunPlan, name: str) -> None:
    """Raise PlanError unless the plant's numbers are in the same places for both plans."""
    lists = [
        [number.place for number in numbers_of_loop(p) if number.place.startswith("surroundings")]
        for p in (first, plan)
    ]
    if lists[0] != lists[1]:
        raise PlanError(f"--controller {name}: its plant has another form: make a lab of its own")


def _knob_data(
    plans: Mapping[str, RunPlan], node: str, name: str, knob: Knob | RuleKnob
) -> dict[str, Any]:
    if isinstance(knob, RuleKnob):
        return {**vars(knob), "labels": dict(knob.labels)}
    declared = declarations(type(_config_of(plans, node)))[name]
    return {
        "places": knob.places,
        "kind": knob.kind,
        "low": plain(knob.low),
        "high": plain(knob.high),
        "above": declared.above,
        "unbounded": declared.unbounded,
        "excluded": knob.excluded,
        "array": knob.array,
    }


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, mtime=0)).decode("ascii")


_ASSETS = files(__package__) / "assets"
# Before the parts: what stands in the place of a connection. Behind them: what a lab alone has.
_FEED = ("engine.js", "setup.js", "feed.js")
_OWN = ("events.js", "lab.js")


def render(lab: Mapping[str, Any]) -> str:
    """Return the page of a lab's data."""
    names = scripts(list(_FEED), list(_OWN))
    own = {*_FEED, *_OWN}
    script = inline("\n".join(_asset(name) if name in own else part(name) for name in names))
    data = _json(lab)
    digest = hashlib.sha256(f"{script}{data}".encode()).hexdigest()[:16]  # of all that computes
    data = _json({**lab, "digest": digest})
    return page(
        f"Lab: {lab['scenario']}",
        f"<style>{''.join(map(part, STYLES))}</style>",
        f'<script type="application/json" id="lab-data">{data}</script>\n<script>{script}</script>',
        lab=True,
        policy=policy(script, " 'wasm-unsafe-eval'", "data: blob:"),
    )


def write(lab: Mapping[str, Any], path: Path) -> int:
    """Write the page; return its size in bytes. Raises OSError."""
    return write_page(render(lab), path)


def _json(data: Mapping[str, Any]) -> str:
    return htmlsafe_json_dumps(data, allow_nan=False, separators=(",", ":"))


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")
