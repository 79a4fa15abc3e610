"""A quarter of a minute of scripts/check_soak.py; by hand it runs for half an hour.

At 1 kHz, so that a publisher already keeps its 5000 messages when its memory is first measured.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from .processes import Children

pytestmark = [pytest.mark.graph, pytest.mark.slow]

SCRIPT = Path(__file__).parents[2] / "scripts" / "check_soak.py"


@pytest.mark.long
def test_a_quarter_of_a_minute(children: Children) -> None:
    # On a busy machine a recorder may be up to 5000 messages of each topic behind, half a minute or an
    # hour after its start: a tenth of its memory, and no leak.
    given = ("--minutes", 0.25, "--rate", 1000, "--growth", 0.15)
    # On a machine that busy, nodes that end wait longer for those that have yet to hear from them.
    soak = children.start("soak", "env", "TRUNK_PATIENCE=4", sys.executable, SCRIPT, *given)
    assert soak.wait() == 0, soak.stdout + soak.stderr
    children.none_left()
    for node in ("simulator", "disturbance", "fuzzy_pid", "recorder"):
        assert f"  {node} " in soak.stdout
    assert "15001 states" in soak.stdout
    assert soak.stdout.splitlines()[-1] == "check_soak: 0.25 min at 1000 Hz passed"


def test_an_impossible_run_fails_in_one_line(children: Children) -> None:
    soak = children.start("soak", sys.executable, SCRIPT, "--rate", 0)
    assert soak.wait() == 1
    (line,) = soak.stderr.splitlines()
    assert line.startswith("check_soak: FAILED: ")
    assert "update_rate" in line
