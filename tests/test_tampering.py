"""Every edit of an offline recording is refused by `trunk verify`, or listed with the reason.

A selection of python -m tests.tampering.check, which edits recordings of the graph, too.
"""

from collections import Counter
from pathlib import Path

import pytest
from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, KEPT, NONE, content

from trunk_msgs_util.events import Event

from .tampering.accepted_edits import ACCEPTED
from .tampering.bases import OFFLINE, make_base
from .tampering.check import outcomes, sample
from .tampering.edits import edits_of
from .tampering.honest import offline_runs


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    path = tmp_path_factory.mktemp("tampering") / "base.mcap"
    make_base(OFFLINE, path, duration=0.06)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("digests", "share"),
    [
        (ANEW, 0.02),
        pytest.param(KEPT, 0.002, marks=pytest.mark.one_in(8)),
        pytest.param(NONE, 0.002, marks=pytest.mark.one_in(8)),
    ],
)
def test_every_edit_is_refused_or_listed(base, tmp_path, digests, share):
    found = list(outcomes(OFFLINE, base, tmp_path, (digests,), sample(share)))
    assert len(found) > 1000 * share
    assert not [f"{one.name}: {one.wrong}" for one in found if one.wrong]
    kinds = Counter(one.exit_code for one in found)
    assert kinds[1] > 0


def test_every_event_can_be_edited_and_added(base):
    found = content(base)
    edits = [edit for edit in edits_of(found) if edit.kind.startswith("event")]
    for one in edits:
        one.apply(found.copy())
    assert {f"simulator {word} half way" for word in Event} <= {one.name for one in edits}


@pytest.mark.slow
def test_honest_runs_are_not_accused(tmp_path):
    assert not [f"{run.name}: {run.accused}" for run in offline_runs(12, tmp_path) if run.accused]


def test_what_passes_is_documented():
    written = (Path(__file__).parents[1] / "docs" / "recording.md").read_text(encoding="utf-8")
    listed = [line[2:] for line in written.splitlines() if line.startswith("- ")]
    assert not [reason for _, reason in ACCEPTED if reason not in listed]
