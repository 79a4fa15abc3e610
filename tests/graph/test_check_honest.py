"""python -m tests.honest.check, briefly: it judges runs, sees what is missing, and leaves nothing behind."""

from __future__ import annotations

import re
import signal
import sys
from pathlib import Path

import pytest
from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, copied

from ..honest.trial import KINDS, draw
from ..honest.whole import Content, lacking
from ..tampering.bases import REAL_TIME, make_base
from .processes import Children, until

pytestmark = pytest.mark.graph

CHECK = ("env", "-C", Path(__file__).parents[2], sys.executable, "-m", "tests.honest.check")


@pytest.mark.long
def test_two_runs(children: Children) -> None:
    check = children.start("check", *CHECK, 2, "--workers", 2, "--busy", 1)
    assert check.wait() == 0, check.stdout + check.stderr
    last = check.stdout.splitlines()[-1]
    assert re.fullmatch(r"2 honest runs: .* 0 diverge, 0 falsely complete", last), last


@pytest.mark.long
def test_it_ends_what_it_started(children: Children) -> None:
    check = children.start("check", *CHECK, 50)
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
