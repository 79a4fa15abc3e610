"""What a page needs besides a run's numbers to write its recording: what is the same in each of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trunk_control.laws import law_named
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.provenance import NONE, of_page
from trunk_msgs_util.recording import rosbag2
from trunk_msgs_util.recording.schemas import definition
from trunk_msgs_util.recording.writer import PROFILE

from ..plans.plan import RunPlan
from ..runs import states
from ..runs.offline_recording import HAS_FALLEN, OfflineRecorder

_ZERO = -1  # instead of a column
_NO_COLUMNS = slice(0, 0)
_EVENTS = (Event.STARTED, Event.RETUNED, Event.FELL, Event.FINISHED, Event.FAILED)


def recording_template(plans: Mapping[str, RunPlan]) -> dict[str, Any]:
    """Return, as JSON has it, what a lab needs besides numbers and parameters to record these plans' runs.

    A type has its definition, the metadata of its channels and their part of the bag's summary; a stream of
    joint states its topic, its names, and for each value its column in the table of `runs.states`. The plans
    are such as `data.check_plan` accepts.
    """
    origin = of_page()
    runs = {name: _run(name, plan, origin) for name, plan in plans.items()}
    topic_of = {type_name: topic for run in runs.values() for topic, type_name in run["channels"]}
    summaries = {type_name: _summary(topic, type_name) for type_name, topic in topic_of.items()}
    head, _, tail = summaries[topics.JOINT_STATE_TYPE]
    return {
        "header": [PROFILE, f"trunk_experiments {origin['trunk_experiments']}, in a browser"],
        "types": {
            type_name: {
                "definition": definition(type_name).decode(),
                "metadata": rosbag2.channel_metadata(topic, type_name),
                "summary": summaries[type_name][1],
            }
            for type_name, topic in topic_of.items()
        },
        "summary": [head, tail],
        "topics": {
            "events": _absolute(topics.RUN_EVENTS),
            "parameters": _absolute(topics.RUN_PARAMETERS),
        },
        "words": {event.name.lower(): event.value for event in _EVENTS},
        "reasons": {"fell": HAS_FALLEN, "end": OfflineRecorder.at_end},
        "columns": {
            "angle": _columns(states.POSITION)[1],
            "updated": states.FRESH,
            "disturbance": _columns(states.ACTING) + _columns(states.OFFSET),
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
    head, begin, rest = text.partition("- topic_metadata:")
    part, end, tail = rest.partition("compression_format:")
    return head, begin + part, end + tail


def _run(name: str, plan: RunPlan, origin: Mapping[str, str]) -> dict[str, Any]:
    """Return the part of the template in which the controllers differ."""
    known = {"scenario": plan.scenario, "controller": name, "mode": "offline", "rmw": NONE}
    types = topics.evidence_types((name,))
    return {
        "provenance": {**origin, **known},
        "channels": [[_absolute(topic), type_name] for topic, type_name in types.items()],
        "streams": _streams(name, plan.simulator.joints),
        "nodes": [node for node in plan.configs if node != "recorder"],
        "rate": str(plan.simulator.update_rate),
    }


def _streams(name: str, joints: tuple[str, ...]) -> dict[str, Any]:
    """Return the messages of joint states that come with a state; the columns of pushes are theirs alone."""
    terms = law_named(name).record_names
    of_terms = slice(states.TERMS, states.TERMS + len(terms))
    seen = states.SEEN_POSITION, states.SEEN_VELOCITY
    return {
        "truth": _layout(
            topics.GROUND_TRUTH, joints, states.POSITION, states.VELOCITY, [_ZERO, states.APPLIED]
        ),
        "disturbance": _layout(
            topics.DISTURBANCE, joints, states.OFFSET, effort=_columns(states.ACTING)
        ),
        "measured": _layout(topics.JOINT_STATES, joints, *seen, [_ZERO, states.SEEN_APPLIED]),
        "command": _layout(topics.EFFORT_COMMAND, joints[1:], effort=[states.EFFORT]),
        "terms": _layout(topics.controller_state(name), terms, of_terms),
        "push": _layout(topics.OPERATOR_PUSH, joints, effort=[0, 1]),
    }


def _layout(
    topic: str,
    names: Sequence[str],
    position: slice = _NO_COLUMNS,
    velocity: slice = _NO_COLUMNS,
    effort: Sequence[int] = (),
) -> dict[str, Any]:
    return {
        "topic": _absolute(topic),
        "names": names,
        "position": _columns(position),
        "velocity": _columns(velocity),
        "effort": effort,
    }
