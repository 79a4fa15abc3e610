"""Runs give the messages and the verdicts that were frozen: a share each time, all of them with --all."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from ros2_ws.src.trunk_msgs_util.test.mcap_files import Content, content, copied

from trunk_experiments.plans.timeline import Change
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.schemas import event, parameter_event

from ..finished import finished
from . import caught, verdicts
from .caught import Caught
from .check import ROOT, differences, frozen_runs
from .contents import digests_of
from .edits import numbers_of
from .features import FEATURES
from .runs import LOCKSTEP, MS, OFFLINE, Fingerprint, offline, pushed, swapped
from .verdicts import NO_FILE, Outcome

LONG = [name for name in OFFLINE if name.startswith("long")]
SHORT = [name for name in OFFLINE if name not in LONG]


def shares(names: list[str], count: int) -> list[list[str]]:
    """Return shares of about the same size, each with runs of every sort."""
    return [names[number::count] for number in range(count)]


def changed_since_frozen(names: list[str], folder: Path) -> list[str]:
    before = frozen_runs()
    return [
        f"{name}: {line}"
        for name in names
        for line in differences(before[name], offline(name, folder))
    ]


@pytest.mark.slow
@pytest.mark.one_in(20)
@pytest.mark.parametrize("names", shares(SHORT, 20), ids=range(20))
def test_offline_runs_are_as_they_were(names: list[str], tmp_path: Path) -> None:
    assert changed_since_frozen(names, tmp_path) == []


@pytest.mark.slow
@pytest.mark.one_in(8)
@pytest.mark.parametrize("name", LONG)
def test_compiled_runs_are_as_they_were(name: str, tmp_path: Path) -> None:
    assert changed_since_frozen([name], tmp_path) == []


@pytest.mark.slow
@pytest.mark.one_in(8)
@pytest.mark.parametrize("names", shares(list(LOCKSTEP), 8), ids=range(8))
def test_runs_in_lockstep_are_as_they_were(names: list[str]) -> None:
    """In a process of their own, which loads another rclpy."""
    command = [sys.executable, "-m", "tests.frozen.check", "compare", "runs"]
    command += [f"--run={name}" for name in names]
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    done = finished(command, cwd=ROOT, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout == f"{len(names)} runs, 0 differ\n"


def test_every_run_is_frozen() -> None:
    assert list(frozen_runs()) == [*OFFLINE, *LOCKSTEP]


@pytest.mark.parametrize(
    ("now", "line"),
    [
        (Fingerprint("verified", 2, {"/a": "01", "/b": "02"}), None),
        (Fingerprint("verified", 2, {"/a": "01", "/b": "03"}), "/b has other messages"),
        (Fingerprint("verified", 2, {"/a": "01"}), "/b is not there"),
        (Fingerprint("verified", 2, {"/a": "01", "/b": "02", "/c": "03"}), "/c was not there"),
        (Fingerprint("verified", 3, {"/a": "01", "/b": "02"}), "3 states, were 2"),
        (Fingerprint("diverges", 2, {"/a": "01", "/b": "02"}), "diverges, was verified"),
    ],
)
def test_every_difference_is_found(now: Fingerprint, line: str | None) -> None:
    before = Fingerprint("verified", 2, {"/a": "01", "/b": "02"})
    assert list(differences(before, now)) == ([line] if line else [])


def bit(messages: list[list[Any]]) -> None:
    data = bytearray(messages[-1][2])
    data[-1] ^= 1
    messages[-1][2] = bytes(data)


def log_time(messages: list[list[Any]]) -> None:
    messages[-1][1] += 1


def order(messages: list[list[Any]]) -> None:
    messages[-1][1:3], messages[-2][1:3] = messages[-2][1:3], messages[-1][1:3]


@pytest.mark.parametrize("edit", [bit, log_time, order])
def test_a_digest_covers(edit: Callable[[list[list[Any]]], None], tmp_path: Path) -> None:
    path, copy = tmp_path / "run.mcap", tmp_path / "copy.mcap"
    record_offline(OFFLINE["noise, lqr"](), path)

    def in_one_topic(messages: list[list[Any]]) -> None:
        edit([message for message in messages if message[0] == "/joint_states"])

    copied(path, copy, in_one_topic)
    before, now = digests_of(path, graph=False), digests_of(copy, graph=False)
    assert [topic for topic in before if before[topic] != now[topic]] == ["/joint_states"]


def test_digests_of_a_graph_leave_out_processes_and_paths(tmp_path: Path) -> None:
    def identities(messages: list[list[Any]]) -> None:
        values = {"process": f"{path.stem}.1.0", "kind": "pid"}
        data = event(-1, "/pid", Event.CONFIGURED, values)
        messages.append(["/run/events", 0, data, 0, 0])
        data = parameter_event(-1, "/recorder", {"output": str(path), "markers": False}, {})
        messages.append(["/run/parameters", 0, data, 0, 0])

    digests = []
    record_offline(OFFLINE["noise, lqr"](), tmp_path / "run.mcap")
    for path in (tmp_path / "first.mcap", tmp_path / "second.mcap"):
        copied(tmp_path / "run.mcap", path, identities)
        digests.append([digests_of(path, graph) for graph in (True, False)])
    (graph, whole), (other_graph, other_whole) = digests
    assert graph == other_graph
    changed = [topic for topic in whole if whole[topic] != other_whole[topic]]
    assert changed == ["/run/events", "/run/parameters"]


SEEDS = [
    Outcome("lockstep", "V", "0a1b"),
    Outcome("real_time", "c", "ffff"),
    Outcome("lockstep", "n", NO_FILE),
]


def test_what_became_of_seeds_is_kept() -> None:
    many = SEEDS * 50
    assert verdicts.unpacked(json.loads(json.dumps(verdicts.packed(many)))) == many


@pytest.mark.parametrize(
    ("seed", "now", "line", "wrong"),
    [
        (0, Outcome("lockstep", "V", "0000"), None, False),
        (
            0,
            Outcome("lockstep", "c", "0a1b"),
            (
                "lockstep, verified, complete; now lockstep, inconclusive: "
                "1 seeds, 1 with the same recording: 0"
            ),
            True,
        ),
        (
            1,
            Outcome("real_time", "V", "0000"),
            (
                "real_time, inconclusive; now real_time, verified, complete: "
                "1 seeds, 0 with the same recording: 1"
            ),
            False,
        ),
        (
            1,
            Outcome("real_time", "d", "ffff"),
            (
                "real_time, inconclusive; now real_time, diverges: "
                "1 seeds, 1 with the same recording: 1"
            ),
            True,
        ),
    ],
)
def test_a_seed_with_another_verdict_is_found(
    seed: int, now: Outcome, line: str | None, wrong: bool
) -> None:
    outcomes = [*SEEDS[:seed], now, *SEEDS[seed + 1 :]]
    lines = [(change.describe(), change.wrong) for change in verdicts.changes(SEEDS, outcomes)]
    assert lines == ([(line, wrong)] if line else [])


EDITS = {
    "offline: stamps: /joint_states first stamp + 1 ns": Caught("n", "d"),
    "offline: parameter: pid.gains.p, set, another value (0)": Caught("n", "p", "never used"),
    "lockstep: header: library": Caught("o", "d"),
}
CAUGHT, LISTED, HEADER = EDITS


def test_what_became_of_edits_is_kept() -> None:
    assert caught.unpacked(caught.packed(EDITS)) == EDITS


NEW = "offline: order: /joint_states backwards"


@pytest.mark.parametrize(
    ("name", "now", "line", "wrong"),
    [
        (CAUGHT, "nd", "0 edits that change a number pass now and did not", False),
        (CAUGHT, "np", f"{CAUGHT}: a number changed: it was caught, and passes now", True),
        (CAUGHT, "nr", f"{CAUGHT}: verify raises", True),
        (CAUGHT, "nc", "1 caught as before by another word: diverges, now inconclusive", False),
        (LISTED, "nd", "1 caught now that passed; parameter: 1", False),
        (HEADER, "op", "1 others pass now and did not; header: 1", False),
        (NEW, "np", f"{NEW}: a number changed: it passes, and was not frozen", False),
        (NEW, "op", "1 not frozen, 0 gone", False),
    ],
)
def test_an_edit_that_slips_through_is_found(name: str, now: str, line: str, wrong: bool) -> None:
    comparison = caught.compared(EDITS, {**EDITS, name: Caught(*now)})
    assert line in comparison.lines()
    assert comparison.wrong == wrong


def without(event: Event) -> Callable[[list[list[Any]]], None]:
    def edit(messages: list[list[Any]]) -> None:
        messages[:] = [message for message in messages if event.encode() not in message[2]]

    return edit


@pytest.fixture(scope="module")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """Return a recording with pushes, disturbances, a turn, a fall, a reset and a change."""
    path = tmp_path_factory.mktemp("eventful") / "run.mcap"
    plan = pushed("pid", "simulator.fall.angle=0.3", *FEATURES["sine"])
    changes = [Change(150 * MS, None), Change(200 * MS, {"plant.length": 1.1})]
    turns = swapped("pid", (0.1, "lqr")).controllers
    record_offline(replace(plan, controllers=turns, changes={"simulator": changes}), path)
    return content(path)


@pytest.mark.parametrize(
    ("topic", "edit", "number"),
    [
        ("/joint_states", bit, True),
        ("/ground_truth/joint_states", log_time, False),
        ("/disturbance", order, False),
        ("/effort_command", list.clear, True),
        ("/pid/state", lambda messages: messages.append(messages[0]), False),
        ("/pid/state", lambda messages: messages.pop(), True),
        ("/operator/push", bit, True),
        ("/run/events", without(Event.RESET), True),
        ("/run/events", without(Event.FELL), True),
        ("/run/events", without(Event.ACTIVATED), True),
        ("/run/events", without(Event.STARTED), False),
        ("/run/parameters", lambda messages: messages.pop(), True),
    ],
)
def test_an_edit_of_a_number_is_known_by_what_it_changes(
    topic: str, edit: Callable[[list[list[Any]]], object], number: bool, eventful: Content
) -> None:
    edited = eventful.copy()
    messages = edited.of(topic)
    edited.messages = [message for message in edited.messages if message[0] != topic]
    edit(messages)
    edited.messages += messages
    assert (numbers_of(edited) != numbers_of(eventful)) == number


def test_a_namespace_and_an_order_are_no_numbers(eventful: Content) -> None:
    edited = eventful.copy()
    for message in edited.messages:
        message[0] = f"/robot{message[0]}"
    edited.channels = {f"/robot{topic}": channel for topic, channel in edited.channels.items()}
    edited.messages.reverse()
    assert numbers_of(edited) == numbers_of(eventful)
