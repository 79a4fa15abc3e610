"""What is run before a release, briefly: it does what it says, and leaves nothing behind."""

from __future__ import annotations

import json
import re
import signal
import sys
from pathlib import Path

import pytest
from benchmarks.nodes import LATENCY, MEASURES
from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, copied

from ..honest.trial import KINDS, draw
from ..honest.whole import Content, lacking
from ..tampering.bases import REAL_TIME, make_base
from .processes import Child, Children, until

pytestmark = pytest.mark.graph

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "scripts"


def module(children: Children, *words: object) -> Child:
    """Start a module from the project's root."""
    return children.start("module", "env", "-C", ROOT, sys.executable, "-m", *words)


@pytest.mark.slow
def test_bad_arguments_lose_nothing_and_get_one_line(children: Children) -> None:
    """Some twenty; `python -m tests.hostile.arguments` tries all with every verb, `trunk run` among them."""
    run = module(children, "tests.hostile.arguments", "--every", 397)
    assert run.wait() == 0, run.stdout + run.stderr
    cases = run.stdout.splitlines()[-1]
    assert cases.endswith(", 0 wrong")
    assert int(cases.split()[0]) >= 19


# scripts/check_soak.py; by hand it runs for half an hour.


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_quarter_of_a_minute(children: Children) -> None:
    """At 1 kHz, so that a publisher already keeps its 5000 messages when its memory is first measured."""
    # On a busy machine a recorder may be up to 5000 messages of each topic behind, half a minute or an
    # hour after its start: a tenth of its memory, and no leak.
    given = ("--minutes", 0.25, "--rate", 1000, "--growth", 0.15)
    # On a machine that busy, nodes that end wait longer for those that have yet to hear from them.
    check = (sys.executable, SCRIPTS / "check_soak.py", *given)
    soak = children.start("soak", "env", "TRUNK_PATIENCE=4", *check)
    assert soak.wait() == 0, soak.stdout + soak.stderr
    children.none_left()
    for node in ("simulator", "disturbance", "fuzzy_pid", "recorder"):
        assert f"  {node} " in soak.stdout
    assert "15001 states" in soak.stdout
    assert soak.stdout.splitlines()[-1] == "check_soak: 0.25 min at 1000 Hz passed"


@pytest.mark.slow
def test_an_impossible_run_fails_in_one_line(children: Children) -> None:
    soak = children.start("soak", sys.executable, SCRIPTS / "check_soak.py", "--rate", 0)
    assert soak.wait() == 1
    (line,) = soak.stderr.splitlines()
    assert line.startswith("check_soak: FAILED: ")
    assert "update_rate" in line


# python -m tests.honest.check: it judges runs, and sees what is missing.


@pytest.mark.one_in(8)
def test_two_runs(children: Children) -> None:
    check = module(children, "tests.honest.check", 2, "--workers", 2, "--busy", 1)
    assert check.wait() == 0, check.stdout + check.stderr
    last = check.stdout.splitlines()[-1]
    assert re.fullmatch(r"2 honest runs: .* 0 diverge, 0 falsely complete", last), last


@pytest.mark.one_in(8)
def test_it_ends_what_it_started(children: Children) -> None:
    check = module(children, "tests.honest.check", 50)
    until(lambda: len(children.pids()) > 8, "it starts processes, they start nodes")
    assert check.stop(signal.SIGINT) == 130, check.stderr
    assert "Traceback" not in check.stderr
    children.none_left()


def test_each_kind_of_disturbance_is_drawn() -> None:
    assert {kind for seed in range(200) for kind in draw(seed).kinds} == {*KINDS}


def test_what_is_missing_is_seen(domain: int, tmp_path: Path) -> None:
    """The recording is copied without one message at a time, with its digests right."""
    whole = tmp_path / "whole.mcap"
    make_base(REAL_TIME, whole, 0.1)
    content = Content(whole)
    assert content.complete
    assert list(lacking(content, {})) == []
    assert list(lacking(content, {"simulator": [{"plant.length": 1.1}]})) == []
    assert list(lacking(content, {"simulator": [{"plant.length": 1.2}]}))
    for topic in (*content.joints, "/run/events"):
        if topic == "/reference":
            continue

        def lose(messages: list[list[object]], topic: str = topic) -> None:
            of_topic = [message for message in messages if message[0] == topic]
            ends = [m for m in of_topic if b"finished" in m[2]]  # type: ignore[operator]
            messages.remove((ends or of_topic)[len(ends or of_topic) // 2])

        copied(whole, tmp_path / "less.mcap", lose, ANEW)
        assert list(lacking(Content(tmp_path / "less.mcap"), {})), topic


# Benchmarks with real nodes.

PD = ROOT / "examples" / "nodes" / "pd_rclpy.py"
LOOPS = ("pid", "fuzzy_pid", "fuzzy_pid, recorder")
SHORT = ("--rate", 100, "--seconds", 0.5, "--rounds", 1)


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_every_row(children: Children) -> None:
    child = module(children, "benchmarks", "realtime", *SHORT, "--json")
    assert child.wait() in (0, 1), child.stderr  # 1: a goal was missed, on a busy machine
    children.none_left()
    assert child.stdout, child.stderr
    rows = json.loads(child.stdout)["rows"]
    assert [row["name"] for row in rows] == [f"{loop}: {one}" for loop in LOOPS for one in MEASURES]
    for row in rows:
        if row["name"].endswith(LATENCY):
            assert row["ours"] > 0.0
            assert row["ratio"] == pytest.approx(row["ours"] / row["theirs"])
            assert (row["goal"], row["met"]) == ("<= 1.3", row["ratio"] <= 1.3)


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_wrong_rate_is_refused_by_name(children: Children) -> None:
    child = module(children, "benchmarks", "realtime", "--rate", 0)
    assert child.wait() == 2
    assert "'--rate'" in child.stderr


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_node_of_somebody_elses_beside_ours(children: Children) -> None:
    child = module(children, "benchmarks", "external", f"{sys.executable} {PD}", *SHORT)
    assert child.wait() == 0, child.stderr
    children.none_left()
    measures = ("late steps", "lock-step, steps/s", "latency, median", "unanswered states")
    for measure in measures:
        assert len([line for line in child.stdout.splitlines() if measure in line]) == 1
    assert "/my_pd" in child.stderr
