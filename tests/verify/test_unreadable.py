"""Messages that cannot be read, which anybody may send: the run is not judged, and nobody is accused."""

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, content, copied, write

from trunk_core.topics import Event
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verify
from trunk_experiments.cli import trunk
from trunk_recording.schemas import event
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from .messages import COMMAND, of

REFERENCE = "/reference"


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    path = tmp_path_factory.mktemp("unreadable") / "run.mcap"
    record_offline(make_plan("fig8", "pid", everywhere={"duration": 0.1}), path)
    return path


def cut_references(messages):
    """Add what a stranger's node sent while the run went on: cut messages, a whole one between them."""
    (whole, log_time_ns) = of(messages, COMMAND)[40][2], of(messages, COMMAND)[40][1]
    for number, data in enumerate((whole[:30], whole, b"\0\1\0\0", whole[:30])):
        messages.append([REFERENCE, log_time_ns, data, log_time_ns, number])


def test_unreadable_messages_are_only_an_obstacle(honest, tmp_path):
    verdict = verify(copied(honest, tmp_path / "a.mcap", cut_references, digests=ANEW))
    assert verdict.exit_code == UNJUDGED, verdict.reasons
    assert not verdict.diverges
    assert any(f"{REFERENCE} is not read: message " in line for line in verdict.reasons)


@pytest.mark.parametrize("end", [True, False], ids=["complete", "cut"])
def test_a_count_of_thousands_of_digits_is_none(honest, tmp_path, end):
    """Python reads no such number: it raises ValueError."""

    def edit(messages):
        (*_, (topic, log_time, _, *rest)) = of(messages, "/run/events")
        said = event(0, "/simulator", Event.PUBLISHED, {COMMAND: "9" * 5000})
        messages.append([topic, log_time, said, *rest])

    provenance = {"mode": "lockstep"}
    verdict = verify(copied(honest, tmp_path / "a.mcap", edit, ANEW, end, provenance))
    assert verdict.exit_code == (VERIFIED if end else UNJUDGED)


def test_a_controller_of_which_there_is_nothing_else_is_only_an_obstacle(honest, tmp_path):
    """Nor does an external node that connected make an offline run its own."""
    found = content(honest)
    state = replace(found.channels["/pid/state"], topic="/assistant/state")
    found.channels["/assistant/state"] = state
    found.messages += [["/assistant/state", *message[1:]] for message in found.of("/pid/state")]
    said = event(-1, "/simulator", Event.CONNECTED, {"node": "/assistant", "middleware": "x"})
    found.messages.insert(0, ["/run/events", 0, said, 0, 0])
    verdict = verify(write(found, tmp_path / "a.mcap", ANEW))
    assert verdict.exit_code == UNJUDGED
    assert "assistant is not known here: install the package that has it" in verdict.obstacles


@pytest.mark.parametrize("at", ["1e308", "-1", "nan", "x"])
def test_a_branch_at_no_time_is_none(tmp_path, at):
    branch = {"branch_of": "ab" * 32, "branch_parent": "a", "branch_at": at, "branch_changes": "-"}
    real_time = Path(__file__).parents[1] / "archive" / "d192e8e1_rt.mcap"
    verdict = verify(copied(real_time, tmp_path / "a.mcap", digests=ANEW, provenance=branch))
    assert not any("branch" in note for note in verdict.notes)


def test_the_command_does_not_call_judged_what_it_cannot_judge(honest, tmp_path):
    copied(honest, tmp_path / "a.mcap", cut_references, digests=ANEW)
    done = CliRunner().invoke(trunk, ["verify", str(tmp_path / "a.mcap")])
    first, *lines = done.output.splitlines()
    assert first.endswith(": inconclusive")
    assert any(line.startswith("  recomputed all the same: t = 0 to 0.1 s") for line in lines)
    assert not any(line.startswith("  judged: ") for line in lines)
    (judged,) = [
        line
        for line in CliRunner().invoke(trunk, ["verify", str(honest)]).output.splitlines()
        if "t = 0 to 0.1 s" in line
    ]
    assert judged.startswith("  judged: ")
