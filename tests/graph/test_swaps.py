"""Controllers that take over from each other, or join, while the plant moves; a simulator begun anew."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, copied

from trunk_core import topics
from trunk_core.units import seconds
from trunk_evidence.judgement import DIVERGES, UNJUDGED, VERIFIED, verify
from trunk_msgs_util.node.conversions import stamp_from_ros
from trunk_msgs_util.source import process_id
from trunk_recording.reader import Recording

from .peer import Peer
from .processes import Child, Children
from .services import Services
from .verbs import said, verified

pytestmark = pytest.mark.graph


def deactivate(peer: Peer, name: str, follower: str) -> None:
    """Deactivate a controller, and wait until the one that is to take over has seen the last state it saw.

    In real time both may answer a state otherwise, and of two such answers `verify` judges neither.
    """
    assert Services(peer, name).change("deactivate")
    (turn,) = peer.until(
        lambda: [e for e in peer.events if (e.node, e.message) == (f"/{name}", "deactivated")],
        "it says so",
    )
    seen_s = seconds(turn.stamp_ns)
    peer.until(
        lambda: float(peer.fresh_diagnostics(follower)["time"]) >= seen_s, "the other follows"
    )


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
def test_a_swap_by_hand(children: Children, peer: Peer, tmp_path: Path) -> None:
    """One controller is deactivated, then another activated, while the plant moves in real time."""
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    nodes = [children.node("pid"), children.node("fuzzy_pid", "autostart:=false")]
    peer.until_up("fuzzy_pid")
    fuzzy_pid = Services(peer, "fuzzy_pid")
    assert fuzzy_pid.change("configure")
    truth = peer.hear(topics.GROUND_TRUTH)
    simulator = children.node("simulator", "duration:=0.0")
    peer.until_recorded(500)
    deactivate(peer, "pid", "fuzzy_pid")
    assert fuzzy_pid.change("activate")
    fresh = len(truth) + 200
    peer.until(lambda: len(truth) > fresh, "the run goes on")
    for child in (simulator, *nodes, recorder):
        assert child.stop() == 0, child.stderr

    recording = Recording.open(tmp_path / "run.mcap")
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    turned = {
        (e.node, e.message): e.stamp_ns for e in recording.events("/run/events") if e.stamp_ns > 0
    }
    assert turned["/pid", "deactivated"] <= turned["/fuzzy_pid", "activated"]
    first = recording.joints("/fuzzy_pid/state").stamp_ns[0]
    assert first > turned["/fuzzy_pid", "activated"]
    # Its first command is the torque that acted at that time.
    states, commands = recording.joints("/joint_states"), recording.joints("/effort_command")
    acting = states.column("effort", "trunk")[states.stamp_ns == first]
    assert commands.column("effort", "trunk")[commands.stamp_ns == first] == pytest.approx(acting)
    # Repeated offline, no controller commands between the two either.
    said("simulate", "--like", tmp_path / "run.mcap", "-o", tmp_path / "again.mcap")
    repeated = Recording.open(tmp_path / "again.mcap")
    assert verify(repeated).exit_code == VERIFIED, verify(repeated)
    truth_ns = repeated.joints("/ground_truth/joint_states").stamp_ns
    idle_ns = np.setdiff1d(truth_ns, repeated.joints("/effort_command").stamp_ns)
    idle_ns = idle_ns[idle_ns < truth_ns[-1]]  # that one may not have been answered
    a, b = turned["/pid", "deactivated"], turned["/fuzzy_pid", "activated"]
    assert idle_ns.tolist() == truth_ns[(truth_ns > a) & (truth_ns <= b)].tolist()


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
def test_a_controller_joins_a_run_under_way(children: Children, peer: Peer, tmp_path: Path) -> None:
    """It is active from the first state that it receives, and the recording says so."""
    recorder = children.node("recorder", "output:=run.mcap", "controllers:=[pid]")
    pid = children.node("pid")
    simulator = children.node("simulator", "duration:=0.0")
    peer.until_recorded(500)
    assert Services(peer, "pid").change("deactivate")
    updates = peer.hear(topics.controller_state("fuzzy_pid"))
    fuzzy_pid = children.node("fuzzy_pid")
    peer.until(lambda: len(updates) > 100, "it answers")
    for child in (simulator, fuzzy_pid, pid, recorder):
        assert child.stop() == 0, child.stderr
    recording = Recording.open(tmp_path / "run.mcap")
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    turns = [
        e
        for e in recording.events("/run/events")
        if e.node == "/fuzzy_pid" and e.message == "activated"
    ]
    first = recording.joints("/fuzzy_pid/state").stamp_ns[0]
    assert [turn.stamp_ns for turn in turns] == [-1, first - 1]


@pytest.mark.virtual
def test_a_controller_that_outlives_the_recorder_is_not_held_against_the_run(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    """How many commands it gave is not on record; those that are there follow, and it is not accused."""
    recorder = children.node("recorder", "output:=run.mcap")
    pid, fuzzy_pid = children.node("pid"), children.node("fuzzy_pid", "autostart:=false")
    peer.until_up("fuzzy_pid")
    life = Services(peer, "fuzzy_pid")
    assert life.change("configure")
    updates = peer.hear(topics.controller_state("fuzzy_pid"))
    simulator = children.node("simulator", "duration:=0.0")
    peer.until_recorded(300)
    deactivate(peer, "pid", "fuzzy_pid")
    assert life.change("activate")
    peer.until(lambda: len(updates) > 100, "it answers")
    for child in (simulator, pid, recorder, fuzzy_pid):
        assert child.stop() == 0, child.stderr
    path = tmp_path / "run.mcap"
    recording = Recording.open(path)
    assert {e.node for e in recording.events("/run/events") if e.message == "published"} == {
        "/simulator",
        "/pid",
    }
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict.reasons
    given = [len(recording.joints(f"/{name}/state")) for name in ("pid", "fuzzy_pid")]
    states = len(recording.joints("/ground_truth/joint_states"))
    assert min(given) > 0
    assert [(check.name, check.steps) for check in verdict.checks] == [
        ("commands of pid", given[0]),
        ("commands of fuzzy_pid", given[1]),
        ("measured states", states),
        ("states of the plant", states),
        ("inputs of the plant", states),
    ]

    def without_terms(name: str, messages: list[list]) -> None:
        own = [m for m in messages if m[0] == f"/{name}/state"]
        messages.remove(own[len(own) // 2])

    def turned_round(name: str, messages: list[list]) -> None:
        for message in messages:
            if message[0] == "/effort_command" and f"\0{name}@".encode() in message[2]:
                message[2] = message[2][:-1] + bytes([message[2][-1] ^ 0x80])

    for edit, name, code in (
        (without_terms, "fuzzy_pid", UNJUDGED),  # it may never have been received
        (without_terms, "pid", DIVERGES),  # which said how many there were
        (turned_round, "fuzzy_pid", DIVERGES),  # the plant's inputs tell what acted
    ):
        found = verify(copied(path, tmp_path / "edited.mcap", partial(edit, name), ANEW))
        assert found.exit_code == code, (edit.__name__, name, found.reasons)


def run_swapped(children: Children, *arguments: object) -> Child:
    return children.trunk(
        "run", "demo", "--controller", "pid", "--swap-at", "0.5:fuzzy_pid", "--swap-at", "1:pid",
        "--duration", 1.5, "--output", "run", *arguments,
    )  # fmt: skip


@pytest.mark.parametrize(
    "composed",
    [False, pytest.param(True, marks=pytest.mark.one_in(8))],
    ids=["processes", "composed"],
)
def test_a_swap_in_lockstep_has_the_offline_bits(
    children: Children, tmp_path: Path, composed: bool
) -> None:
    run = run_swapped(children, "--lockstep", *(["--composed"] if composed else []))
    assert run.wait() == 0, run.stderr
    children.none_left()
    path = tmp_path / "run" / "run.mcap"
    said("simulate", "--like", path, "-o", tmp_path / "again.mcap")
    said("diff", path, tmp_path / "again.mcap")
    rows = [" ".join(line.split()) for line in verified(path).splitlines()]
    assert "commands of pid 0 s 1.5 s 201 verified" in rows
    assert "commands of fuzzy_pid 0.5 s 0.995 s 100 verified" in rows


@pytest.mark.one_in(8)
def test_a_swap_in_real_time(children: Children, tmp_path: Path) -> None:
    run = run_swapped(children)
    assert run.wait() == 0, run.stderr
    children.none_left()
    recording = Recording.open(tmp_path / "run" / "run.mcap")
    assert verify(recording).exit_code == VERIFIED, verify(recording)
    stamps = {name: recording.joints(f"/{name}/state").stamp_ns for name in ("pid", "fuzzy_pid")}
    assert not np.intersect1d(*stamps.values()).size
    assert (stamps["fuzzy_pid"] >= 500_000_000).all()
    assert (stamps["fuzzy_pid"] < 1_000_000_000).all()
    assert not ((stamps["pid"] >= 500_000_000) & (stamps["pid"] < 1_000_000_000)).any()
    kp = {n: recording.joints(f"/{n}/state").column("position", "kp") for n in stamps}
    assert set(kp["pid"]) == {60.0}
    assert set(kp["fuzzy_pid"]) > {60.0} or 60.0 not in kp["fuzzy_pid"]
    # Each first command of a turn is the torque that acted when it was computed.
    states, commands = recording.joints("/joint_states"), recording.joints("/effort_command")
    for first in (stamps["fuzzy_pid"][0], stamps["pid"][stamps["pid"] >= 1_000_000_000][0]):
        acting = states.column("effort", "trunk")[states.stamp_ns == first]
        given = commands.column("effort", "trunk")[commands.stamp_ns == first]
        assert given == pytest.approx(acting)


COMMANDS = f"/{topics.EFFORT_COMMAND}"
TOPICS = "[effort_command, disturbance]"


@pytest.mark.virtual
def test_two_runs_with_the_same_others(children: Children, peer: Peer) -> None:
    disturbances = peer.hear(topics.DISTURBANCE)
    others = [children.node("pid", "lockstep.enabled:=true"), children.node("disturbance")]
    for run in (1, 2):
        simulator = children.node(
            "simulator", "duration:=1.0", "lockstep.enabled:=true", f"wait_for:={TOPICS}",
            name=f"simulator_{run}",
        )  # fmt: skip
        # In lock-step it ends only where every state was answered by both.
        assert simulator.wait() == 0, simulator.stderr
        peer.until(lambda run=run: len(disturbances) == 202 * run, "each state has its disturbance")
    stamps = [stamp_from_ros(m.header.stamp) for m in disturbances]
    assert stamps[:202] == stamps[202:] == [5_000_000 * k for k in range(202)]
    for node in others:
        assert node.stop() == 0, node.stderr


@pytest.mark.virtual
@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("second", ["pid", "fuzzy_pid"])
def test_a_controller_that_takes_the_place_of_one_that_ended(
    children: Children, peer: Peer, tmp_path: Path, second: str
) -> None:
    """The run goes on; of two processes of one node the first is judged, and the verdict says so."""
    recorder = children.node("recorder", "output:=run.mcap")
    simulator = children.node("simulator", "duration:=0.0")
    first = children.node("pid")
    peer.until_recorded(500)
    assert first.stop() == 0, first.stderr
    inputs = peer.hear(topics.PLANT_INPUTS)
    other = children.node(second, name="second")
    source = f"{second}@{process_id(other.process.pid)}"
    peer.until(lambda: sum(source in m.header.frame_id for m in inputs) > 100, "the other one acts")
    assert [one.stop() for one in (simulator, other, recorder)] == [0, 0, 0]
    recording = Recording.open(tmp_path / "run.mcap")
    verdict = verify(recording)
    names = list(dict.fromkeys(["pid", second]))
    judged = verdict.checks[: len(names)]
    assert [check.name for check in judged] == [f"commands of {name}" for name in names]
    counts = {
        event.source: int(event.values[COMMANDS])
        for event in recording.events("/run/events")
        if event.message == "published" and COMMANDS in event.values
    }
    assert [check.steps for check in judged] == list(counts.values())[: len(names)]
    assert min(counts.values()) > 0
    ended = judged[0].until_ns
    assert ended is not None
    if second == "pid":
        (line,) = verdict.obstacles
        assert line.startswith("pid: another process acts from t = ")
        assert verdict.exit_code == UNJUDGED
    else:
        assert verdict.exit_code == VERIFIED, verdict.reasons
        assert judged[1].from_ns is not None
        assert ended < judged[1].from_ns
    states = recording.joints(f"/{topics.GROUND_TRUTH}").stamp_ns
    assert [check.steps for check in verdict.checks[len(names) :]] == [len(states)] * 3
    for source in counts:

        def without_one(messages: list[list], source: str = source) -> None:
            own = [m for m in messages if m[0] == COMMANDS and f"\0{source}\0".encode() in m[2]]
            messages.remove(own[len(own) // 2])

        found = verify(copied(tmp_path / "run.mcap", tmp_path / "edited.mcap", without_one, ANEW))
        assert found.exit_code != VERIFIED, found.reasons
