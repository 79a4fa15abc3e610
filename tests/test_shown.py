"""Whatever verifies is a right run: all it shows, its log and origin apart, is what the loop gives again.

A forged recording, its digests written anew, is refused, or it shows exactly what its own plan gives.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, Content, content, write, write_file

from trunk_core import topics
from trunk_core.topics import Event
from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.repetition import plan_of
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.schemas import event, parameter_event, parse_parameter_event
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_sim.inputs import Applied

from .real_time import (
    EVENTS,
    PARAMETERS,
    changed,
    configure,
    in_frame,
    late_inputs,
    number,
    record_real_time,
    source_of,
    stamp_at,
)
from .tampering.bases import OFFLINE, make_base
from .tampering.shown import shown_otherwise

TRUTH, DISTURBANCE = f"/{topics.GROUND_TRUTH}", f"/{topics.DISTURBANCE}"
Forgery = Callable[[Content], object]


def differences(path: Path) -> list[str] | None:
    """Return where a recording shows other things than its plan gives; None if it does not verify."""
    try:
        run = RecordedRun.open(path, whole=True)
    except RecordingError:
        return None
    return shown_otherwise(run) if verdict_on(run).exit_code == VERIFIED else None


# Recordings, without processes.


def offline(path: Path) -> None:
    make_base(OFFLINE, path, 0.1)


def real_time(path: Path) -> None:
    source = path.with_suffix(".offline.mcap")
    offline(source)
    record_real_time(plan_of(RecordedRun.open(source)), path)


def late(path: Path) -> None:
    source = path.with_suffix(".offline.mcap")
    make_base(OFFLINE, source, 0.1)
    plan = plan_of(RecordedRun.open(source))
    steps = np.arange(51)
    record_real_time(plan, path, late_inputs(plan, steps // 7 % 2, steps // 11 % 3))


def pushed(path: Path) -> None:
    plan = make_plan("demo", "pid", everywhere={"duration": 0.3, "operator.torque": 30.0})
    record_offline(replace(plan, pushes=((50_000_000, Applied(0.0, 20.0)),)), path)


def linked(path: Path) -> None:
    settings = ["simulator.link.state.loss=0.1", "simulator.link.command.loss=0.1"]
    plan = make_plan("demo", "pid", everywhere={"duration": 0.3}, settings=settings)
    record_real_time(plan, path)


def silent(path: Path) -> None:
    """In real time: no command comes after the first tenth of a second."""
    everywhere = {"duration": 1.5, "update_rate": 50.0, "command_timeout": 0.1}
    plan = make_plan("demo", "pid", everywhere=everywhere, settings=["simulator.fall.angle=10.0"])
    steps = np.arange(76)
    inputs = late_inputs(plan)
    last = np.minimum(inputs.command_ns, inputs.command_ns[5])
    given = np.where(steps <= 10, last, -1)
    answered = {"pid": inputs.answered["pid"][:6]}
    record_real_time(plan, path, replace(inputs, command_ns=given, answered=answered))


BASES = {one.__name__: one for one in (offline, real_time, late, pushed, linked, silent)}


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """Return a base by its name, made once."""
    folder = tmp_path_factory.mktemp("shown")

    def made(name: str) -> Content:
        path = folder / f"{name}.mcap"
        if not path.exists():
            BASES[name](path)
        return content(path)

    return made


@pytest.mark.parametrize("name", ["offline", "real_time", "late", "pushed", "linked"])
def test_an_honest_run_shows_what_its_plan_gives(name, base, tmp_path):
    write_file(base(name), tmp_path / "run.mcap", ANEW)
    assert differences(tmp_path / "run.mcap") == []


# Forgeries. In real time a message names its process.


def fall_at_no_state(recorded: Content, source: str = "") -> None:
    data = event(1, "/simulator", Event.FELL, {"angle": 0.001, "limit": 1.57}, source=source)
    recorded.messages.insert(0, [EVENTS, 0, data, 0, 0])
    number(recorded.messages)


def a_fall_of_another_process(recorded: Content) -> None:
    fall_at_no_state(recorded, source_of("simulator", 2))


def links_of_another_process(recorded: Content) -> None:
    source = source_of("simulator", 2)
    data = event(1, "/simulator", Event.PASSED_ON, {"states lost": 0}, source=source)
    recorded.messages.insert(0, [EVENTS, 0, data, 0, 0])
    number(recorded.messages)


def an_external_controller(recorded: Content) -> None:
    """An event says that somebody's node was connected, and its reference is what the angle was."""
    recorded.channels["/reference"] = replace(
        recorded.channels["/effort_command"], topic="/reference"
    )
    values = {"node": "/x", "middleware": "Fast DDS"}
    data = event(-1, "/simulator", Event.CONNECTED, values, source=_source_in(recorded))
    recorded.messages.insert(0, [EVENTS, 0, data, 0, 0])
    number(recorded.messages)


def _source_in(recorded: Content) -> str:
    return source_of("simulator") if recorded.of("/plant/inputs") else ""


def ghost(node: str, name: str, value: Any, configured: bool = False) -> Forgery:
    """Return the parameters of a process that sent nothing, before all others."""

    def forge(recorded: Content) -> None:
        message = next(m for m in recorded.of(PARAMETERS) if _node_of(m) == node)
        told = parse_parameter_event(message[2])
        assert name in told.new
        kinds = {key: "double array" for key, v in told.new.items() if v == ()}
        values, source = {**told.new, name: value}, source_of(node, 9)
        data = parameter_event(told.stamp_ns, told.node, values, {}, kinds, source)
        recorded.messages.insert(0, [PARAMETERS, 0, data, 0, 0])
        if configured:
            configure(recorded.messages, node, process=9)
        number(recorded.messages)

    return forge


def _node_of(message: list[Any]) -> str:
    return parse_parameter_event(message[2]).node.removeprefix("/")


def terms_of_another(recorded: Content) -> None:
    """Where PID acts, fuzzy PID has terms with a reference of its own, too."""
    terms = recorded.of("/fuzzy_pid/state")[0][2]
    for message in recorded.of("/pid/state"):
        stamp_ns = stamp_at(message[2])
        data = changed(terms, partial(_told_at, stamp_ns))
        place = recorded.messages.index(message)
        recorded.messages.insert(place, ["/fuzzy_pid/state", message[1], data, *message[3:]])
    number(recorded.messages)


def _told_at(stamp_ns: int, terms: Any) -> None:
    terms.header.stamp.sec, terms.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    terms.position = np.append(0.123, terms.position[1:])


def terms_between_states(recorded: Content) -> None:
    """An update at no state has a reference of its own, which would hold until the next one."""
    for message in recorded.of("/pid/state"):
        data = changed(message[2], partial(_told_at, stamp_at(message[2]) + 1))
        place = recorded.messages.index(message) + 1
        recorded.messages.insert(place, [message[0], message[1], data, *message[3:]])
    number(recorded.messages)


def a_strangers_disturbance(recorded: Content) -> None:
    for message in recorded.of(DISTURBANCE):
        data = in_frame(changed(message[2], _of_seven), "")
        recorded.messages.insert(
            recorded.messages.index(message), [*message[:2], data, *message[3:]]
        )
    number(recorded.messages)


def _of_seven(disturbance: Any) -> None:
    disturbance.effort = np.full(2, 7.0)


def terms_of_a_stranger(recorded: Content) -> None:
    for message in recorded.of("/fuzzy_pid/state"):
        data = in_frame(changed(message[2], partial(_told_at, stamp_at(message[2]))), "")
        recorded.messages.insert(
            recorded.messages.index(message), [*message[:2], data, *message[3:]]
        )
    number(recorded.messages)


def a_strangers_last_command(recorded: Content) -> None:
    message = recorded.of("/effort_command")[-1]
    data = in_frame(changed(message[2], _of_one_n_m), "")
    recorded.messages.insert(recorded.messages.index(message), [*message[:2], data, *message[3:]])
    number(recorded.messages)


def _of_one_n_m(command: Any) -> None:
    command.effort = np.ones(1)


def inactive_at_the_end(recorded: Content) -> None:
    """An event says that the controller was made inactive, which it was meant to be."""
    last = recorded.messages[-1][1]
    stamp_ns = stamp_at(recorded.of(TRUTH)[-1][2])
    data = event(stamp_ns, "/pid", Event.DEACTIVATED, {}, source=source_of("pid"))
    recorded.messages.append([EVENTS, last, data, last, 0])
    number(recorded.messages)


def set_to(node: str, name: str, value: Any) -> Forgery:
    """Return another value of a parameter at the start."""

    def forge(recorded: Content) -> None:
        message = next(m for m in recorded.of(PARAMETERS) if _node_of(m) == node)
        told = parse_parameter_event(message[2])
        kinds = {key: "double array" for key, v in told.new.items() if v == ()}
        values = {**told.new, name: value}
        message[2] = parameter_event(told.stamp_ns, told.node, values, {}, kinds, told.source)

    return forge


FORGERIES = [
    ("pushed", set_to("simulator", "fall.angle", 1)),
    ("offline", set_to("simulator", "fall.stop", True)),
    ("offline", set_to("simulator", "duration", 0.05)),
    ("offline", set_to("simulator", "duration", 50.0)),
    ("pushed", set_to("simulator", "operator.torque", 10.0)),
    ("real_time", ghost("simulator", "max_effort", 1.0)),
    ("real_time", ghost("fuzzy_pid", "gains.p_max", 999.0)),
    ("real_time", ghost("fuzzy_pid", "gains.p_max", 999.0, configured=True)),
    ("real_time", ghost("disturbance", "pulse.magnitude", 500.0)),
    ("late", ghost("simulator", "update_rate", 1.0)),
    ("offline", terms_of_another),
    ("offline", terms_between_states),
    ("real_time", terms_between_states),
    ("real_time", terms_of_a_stranger),
    ("real_time", a_strangers_disturbance),
    ("real_time", a_strangers_last_command),
    ("offline", fall_at_no_state),
    ("real_time", fall_at_no_state),
    ("real_time", a_fall_of_another_process),
    ("linked", links_of_another_process),
    ("offline", an_external_controller),
    ("real_time", an_external_controller),
]


@pytest.mark.parametrize(("name", "forge"), FORGERIES)
def test_a_forged_run_is_refused_or_shows_what_its_plan_gives(name, forge, base, tmp_path):
    recorded = base(name)
    forge(recorded)
    write_file(recorded, tmp_path / "run.mcap", ANEW)
    assert not differences(tmp_path / "run.mcap")


def test_an_event_does_not_hide_that_nobody_held_the_trunk(base, tmp_path):
    recorded = base("silent")
    inactive_at_the_end(recorded)
    write_file(recorded, tmp_path / "run.mcap", ANEW)
    run = RecordedRun(Recording.open(tmp_path / "run.mcap", whole=True))
    assert verdict_on(run).exit_code != VERIFIED


def test_what_acted_is_shown_of_a_controller_that_was_started_again(base, tmp_path):
    """It was started with other values before, and ended before the run."""
    recorded = base("real_time")
    acted = RecordedRun(write(recorded, tmp_path / "before.mcap", ANEW)).parameters["fuzzy_pid"]
    ghost("fuzzy_pid", "gains.p_max", 999.0, configured=True)(recorded)
    run = RecordedRun(write(recorded, tmp_path / "run.mcap", ANEW))
    assert verdict_on(run).exit_code == VERIFIED
    assert run.parameters["fuzzy_pid"] == acted


def turned(message: Any) -> None:
    """Tell of the trunk first."""
    message.name = message.name[::-1]
    for quantity in ("position", "velocity", "effort"):
        setattr(message, quantity, getattr(message, quantity)[::-1].copy())


def test_joints_are_told_by_their_names(base, tmp_path):
    recorded = base("offline")
    before = RecordedRun(write(recorded, tmp_path / "before.mcap", ANEW)).evidence
    for message in [*recorded.of(TRUTH), *recorded.of("/joint_states")]:
        message[2] = changed(message[2], turned)
    after = RecordedRun(write(recorded, tmp_path / "run.mcap", ANEW)).evidence
    for one in ("true", "measurements"):
        rows = (0, 51) if one == "true" else (before.stamps,)
        assert np.array_equal(getattr(before, one)(*rows), getattr(after, one)(*rows))
