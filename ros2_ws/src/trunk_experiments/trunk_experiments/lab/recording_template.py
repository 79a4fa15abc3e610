"""What a page needs besides a run's numbers to write its recording: what is the same in each of its runs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from math import isinf
from typing import Any

from trunk_control.laws import law_named
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value, declarations, values_of
from trunk_msgs_util.provenance import of_page
from trunk_msgs_util.recording import rosbag2
from trunk_msgs_util.recording.schemas import definition
from trunk_msgs_util.recording.writer import PROFILE

from ..errors import PlanError
from ..plans.plan import RunPlan
from ..runs import states
from ..runs.offline import check
from ..runs.offline_recording import HAS_FALLEN, OfflineRecorder

_ZERO = -1  # instead of a column


def recording_template(plans: Mapping[str, RunPlan]) -> dict[str, Any]:
    """Return, as JSON has it, all but the numbers of the recordings of these plans' runs, by controller.

    A type has its definition, the metadata of its channels and their part of the bag's summary; a stream of
    joint states its topic, its names, and for each value its column in the table of `runs.states`.

    Raises PlanError for a plan with anything that a page does not record.
    """
    runs = {name: _run(name, plan) for name, plan in plans.items()}
    used = {type_name: topic for run in runs.values() for topic, type_name in run["channels"]}
    summaries = {type_name: _summary(topic, type_name) for type_name, topic in used.items()}
    head, _, tail = next(iter(summaries.values()))
    version = of_page()["trunk_experiments"]
    return {
        "header": [PROFILE, f"trunk_experiments {version}, in a browser"],
        "types": {
            type_name: {
                "definition": definition(type_name).decode(),
                "metadata": rosbag2.channel_metadata(topic, type_name),
                "summary": summaries[type_name][1],
            }
            for type_name, topic in used.items()
        },
        "summary": [head, tail],
        "topics": {
            "events": _absolute(topics.RUN_EVENTS),
            "parameters": _absolute(topics.RUN_PARAMETERS),
        },
        "words": {
            "started": Event.STARTED.value,
            "retuned": Event.RETUNED.value,
            "fell": Event.FELL.value,
            "finished": Event.FINISHED.value,
            "failed": Event.FAILED.value,
        },
        "reasons": {"fell": HAS_FALLEN, "end": OfflineRecorder.at_end},
        "columns": {
            "angle": _columns(states.POSITION)[1],
            "updated": states.FRESH,
            "disturbance": [*_columns(states.ACTING), *_columns(states.OFFSET)],
        },
        "runs": runs,
    }


def _absolute(topic: str) -> str:
    return f"/{topic}"


def _columns(columns: slice) -> list[int]:
    return list(range(columns.start, columns.stop))


def _summary(topic: str, type_name: str) -> tuple[str, str, str]:
    """Return the summary of a bag with one topic: before it, its part, after it; with words for numbers."""
    count = rosbag2.TopicCount(topic, type_name, 0)
    (text,) = rosbag2.summary_record(rosbag2.BagSummary((count,), 0, 0)).values()
    text = text.replace("message_count: 0", "message_count: COUNT").replace(topic, "TOPIC")
    text = text.replace("duration:\n  nanoseconds: 0", "duration:\n  nanoseconds: DURATION")
    parts = re.fullmatch(r"(.*?\n)(- (?:.*\n)*  message_count: COUNT\n)(.*)", text, re.DOTALL)
    assert parts is not None
    head, part, tail = parts.groups()
    return head, part, tail


def _run(name: str, plan: RunPlan) -> dict[str, Any]:
    """Return the part of the template in which the controllers differ."""
    _refuse(name, plan)
    simulator = plan.simulator
    return {
        "provenance": of_page(scenario=plan.scenario, controller=name, mode="offline", rmw="none"),
        "channels": [
            [_absolute(topic), type_name]
            for topic, type_name in topics.evidence_types((name,)).items()
        ],
        "streams": dict(_streams(name, simulator.joints)),
        "nodes": {
            node: list(_parameters(config))
            for node, config in plan.configs.items()
            if node != "recorder"
        },
        "rate": str(simulator.update_rate),
    }


def _streams(name: str, joints: tuple[str, ...]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the messages of joint states that come with each state, and an operator's pushes."""

    def stream(topic: str, names: tuple[str, ...], **columns: list[int]) -> dict[str, Any]:
        return {"topic": _absolute(topic), "names": list(names), **columns}

    position, velocity = _columns(states.POSITION), _columns(states.VELOCITY)
    yield (
        "truth",
        stream(
            topics.GROUND_TRUTH,
            joints,
            position=position,
            velocity=velocity,
            effort=[_ZERO, states.APPLIED],
        ),
    )
    acting, offset = _columns(states.ACTING), _columns(states.OFFSET)
    yield (
        "disturbance",
        stream(topics.DISTURBANCE, joints, position=offset, effort=acting),
    )
    position, velocity = _columns(states.SEEN_POSITION), _columns(states.SEEN_VELOCITY)
    yield (
        "measured",
        stream(
            topics.JOINT_STATES,
            joints,
            position=position,
            velocity=velocity,
            effort=[_ZERO, states.SEEN_APPLIED],
        ),
    )
    yield "command", stream(topics.EFFORT_COMMAND, joints[1:], effort=[states.EFFORT])
    terms = law_named(name).record_names
    columns = list(range(states.TERMS, states.TERMS + len(terms)))
    yield "terms", stream(topics.controller_state(name), terms, position=columns)
    yield "push", stream(topics.OPERATOR_PUSH, joints, effort=[0, 1])


def _parameters(config: Any) -> Iterator[list[Any]]:
    """Yield each parameter's name, kind and value."""
    values = values_of(config)
    for name, declaration in declarations(type(config)).items():
        yield [name, declaration.kind, _plain(values[name])]


def _plain(value: Value) -> Any:
    """Return a value as JSON has it: an infinity is a text."""
    if isinstance(value, tuple):
        return [_plain(element) for element in value]
    if isinstance(value, float) and isinf(value):
        return "Infinity" if value > 0.0 else "-Infinity"
    return value


def _refuse(name: str, plan: RunPlan) -> None:
    """Raise PlanError for anything in a plan that a page does not record."""
    check(plan)
    reasons = {
        "give one controller of ours, without turns": list(plan.controllers) != [name]
        or bool(plan.controller.active_times),
        "set recorder.markers to false: it has no pictures": plan.recorder.markers,
        "set the simulator's link.…, sensor.dropout to nothing: it does not count a link's messages": (
            plan.simulator.network is not None
        ),
        "take a plan without changes, references, pushes or inputs from outside": bool(
            plan.changes or plan.references or plan.pushes or plan.inputs
        ),
    }
    for reason, refused in reasons.items():
        if refused:
            raise PlanError(f"{name}: a page cannot record this run: {reason}")
