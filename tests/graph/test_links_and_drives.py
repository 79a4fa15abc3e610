"""Real drives, sensors and links in real time: their recordings verify."""

from __future__ import annotations

from pathlib import Path

import pytest

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util.recording.reader import Recording

from ..same_bits.scenarios import SCENARIOS
from .processes import Children

pytestmark = [pytest.mark.graph, pytest.mark.long]


@pytest.mark.parametrize("name", ["a drive", "more links"])
def test_a_run_in_real_time_verifies(children: Children, tmp_path: Path, name: str) -> None:
    run = children.trunk("run", *SCENARIOS[name].words, "-o", "run")
    assert run.wait() == 0, run.stderr
    verdict = verify(Recording.open(tmp_path / "run" / "run.mcap"))
    assert verdict.exit_code == VERIFIED, verdict.reasons
