"""A recorder that is asked for a picture records it as it hears the run; the run still verifies."""

from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import stamp_of

from trunk_core import topics
from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_recording.schemas import deserialize

from .processes import Children
from .recordings import finished_file

pytestmark = pytest.mark.graph


@pytest.mark.parametrize(
    "mode",
    [
        pytest.param((), marks=pytest.mark.one_in(8)),
        pytest.param(("--lockstep",), marks=pytest.mark.one_in(8)),
        ("--lockstep", "--composed"),
    ],
    ids=" ".join,
)
def test_a_run_with_its_picture_is_verified(
    children: Children, tmp_path: Path, mode: tuple[str, ...]
) -> None:
    run = children.trunk("run", "demo", "--duration", 2, "--markers", "--output", "run", *mode)
    assert run.wait() == 0, run.stderr
    file = tmp_path / "run" / "run.mcap"
    counts = finished_file(file)
    assert counts["/robot_description"] == 1
    assert counts["/markers"] == counts["/tf"] == 61
    recording = Recording.open(tmp_path / "run")  # as a bag
    assert recording.complete, recording.warnings
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED, verdict
    drawn = set()
    for times, messages in recording.messages("/markers"):
        for log_ns, data in zip(times, messages, strict=True):
            array = deserialize(topics.MARKER_ARRAY_TYPE, data)
            assert {stamp_of(marker.header.stamp) for marker in array.markers} == {log_ns}
            drawn |= {marker.ns for marker in array.markers if marker.action == 0}
    assert drawn >= {"path", "hip", "trunk", "mass", "torque", "reference"}
