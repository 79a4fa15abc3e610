"""Every edit of a recording is refused by `trunk verify`, or it shows exactly what its plan gives.

A selection of python -m tests.tampering.check, which edits recordings of the graph, too.
"""

from collections import Counter

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, KEPT, NONE, content

from trunk_core.topics import Event
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.repetition import plan_of

from .real_time import record_real_time
from .tampering.bases import OFFLINE, REAL_TIME, make_base
from .tampering.check import outcomes, sample
from .tampering.edits import edits_of
from .tampering.honest import offline_runs


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    """Return an offline recording, and its run in real time, without processes."""
    folder = tmp_path_factory.mktemp("tampering")
    paths = {name: folder / f"{name}.mcap" for name in (OFFLINE, REAL_TIME)}
    make_base(OFFLINE, paths[OFFLINE], duration=0.06)
    record_real_time(plan_of(RecordedRun.open(paths[OFFLINE])), paths[REAL_TIME])
    return paths


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "digests", "share"),
    [
        (OFFLINE, ANEW, 0.02),
        (REAL_TIME, ANEW, 0.01),
        pytest.param(OFFLINE, KEPT, 0.002, marks=pytest.mark.one_in(8)),
        pytest.param(OFFLINE, NONE, 0.002, marks=pytest.mark.one_in(8)),
    ],
)
def test_every_edit_is_refused_or_shows_what_its_plan_gives(bases, tmp_path, name, digests, share):
    found = list(outcomes(name, bases[name], tmp_path, (digests,), sample(share)))
    assert len(found) > 1000 * share
    assert not [f"{one.name}: {one.wrong}" for one in found if one.wrong]
    kinds = Counter(one.exit_code for one in found)
    assert kinds[1] > 0
    assert kinds[0] or digests != ANEW


def test_every_event_can_be_edited_and_added(bases):
    found = content(bases[OFFLINE])
    edits = [edit for edit in edits_of(found) if edit.kind.startswith("event")]
    for one in edits:
        one.apply(found.copy())
    assert {f"simulator {word} half way" for word in Event} <= {one.name for one in edits}


@pytest.mark.slow
def test_honest_runs_are_not_accused(tmp_path):
    assert not [f"{run.name}: {run.accused}" for run in offline_runs(12, tmp_path) if run.accused]
