"""`trunk controller check-node`: what a running node does otherwise than it should is named."""

import json
import signal
import sys
from collections.abc import Collection
from pathlib import Path

import pytest

from trunk_experiments.conformance.node_judge import findings, states_to_play
from trunk_experiments.conformance.player_node import Player
from trunk_experiments.errors import RunError

from .processes import Children, until

pytestmark = pytest.mark.graph

_FOREIGN = Path(__file__).with_name("foreign_node.py")
# A fault, and the check that names it.
FAULTS = {
    "wall": "stamp",
    "zero": "stamp",
    "hip": "joint",
    "noname": "joint",
    "empty": "joint",
    "nan": "finite",
    "overflows": "finite",
    "unlimited": "limits",
    "misses": "answers",
    "twice": "once",
    "divides": "rest",
    "random": "bits",
    "keeps_memory": "bits",
    "adds_up": "repeat",
    "stops_at_reset": "reset",
    "stops_after_gap": "gap",
    "talks_in_silence": "silence",
    "slow": "latency",
    "one_behind": "stamp",
}
SOUND = ("none", "both", "copies_the_header", "best_effort")
ONE_OF_EACH = tuple({check: fault for fault, check in FAULTS.items()}.values())


@pytest.mark.parametrize(
    "played",
    [
        (*ONE_OF_EACH, "none"),
        pytest.param({*FAULTS, *SOUND} - {*ONE_OF_EACH, "none"}, marks=pytest.mark.one_in(8)),
    ],
    ids=["one of each", "others"],
)
def test_each_fault_is_named(children: Children, played: Collection[str]) -> None:
    names = sorted(played)
    nodes = children.start(
        "foreign", sys.executable, _FOREIGN, *(f"/{name}={name}" for name in names)
    )
    named = {}
    for name in names:
        with Player(f"/{name}", ("hip", "trunk")) as player:
            transcript = player.play(200.0, player.meet(600.0), limit=100.0)
        named[name] = {check.name for check, found in findings(transcript) if found}
    nodes.stop(signal.SIGKILL)
    assert [n for n in names if n in FAULTS and FAULTS[n] not in named[n]] == []
    # Whether half of the answers took longer than a period is the machine's business, too.
    assert [n for n in names if n in SOUND and named[n] - {"latency"}] == []


def test_ours_keep_every_check(children: Children) -> None:
    node = children.node("fuzzy_pid")
    checked = children.trunk("controller", "check-node", "--limit", 100, "--wait", 600, "--json")
    assert checked.wait() in (0, 1), checked.stderr
    node.stop(signal.SIGKILL)
    document = json.loads(checked.stdout)
    assert document["node"] == "/fuzzy_pid"
    assert {c["name"] for c in document["checks"] if not c["kept"]} <= {"latency"}
    assert document["states"] == len(list(states_to_play(200.0)))


def test_without_a_node_it_says_what_is_there_instead(children: Children) -> None:
    node = children.start("foreign", sys.executable, _FOREIGN, "/elsewhere=none")
    with Player("", ("hip", "trunk")) as player:
        until(lambda: player.sees("/elsewhere/effort_command"), "it is discovered")
        says = r"nobody publishes /effort_command .*/elsewhere/effort_command"
        with pytest.raises(RunError, match=says):
            player.meet(0.0)
    node.stop(signal.SIGKILL)
