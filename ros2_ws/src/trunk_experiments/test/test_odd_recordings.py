"""Recordings as strangers make them: each verb says what is odd about one, and shows no nonsense."""

from __future__ import annotations

import sys

import pytest

from trunk_experiments import cli
from trunk_msgs_util import topics
from trunk_msgs_util.recording.joint_state_cdr import JointStateLayout
from trunk_msgs_util.samples import JointSample

from ...trunk_msgs_util.test.mcap_files import write_mcap

TRUTH = f"/{topics.GROUND_TRUTH}"
MS = 1_000_000
BOTH = ("hip", "trunk")


@pytest.fixture
def trunk(monkeypatch, capsys):
    """Run the command in this process; return exit code, stdout and stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["trunk", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        said = capsys.readouterr()
        return ended.value.code or 0, said.out, said.err

    return run


def states(path, stamps, names=BOTH, values=2, order=None):
    """Write true states with these stamps, each logged a period after the one before; return the path."""
    layout = JointStateLayout(names, values, values, values)
    samples = [
        JointSample(ns, names, *((0.1 * k,) * values for _ in range(3)))
        for k, ns in enumerate(stamps)
    ]
    messages = [(TRUTH, k * MS, layout.pack(s)) for k, s in enumerate(samples)]
    return write_mcap(path, [messages[k] for k in order or range(len(messages))])


@pytest.mark.parametrize(
    ("names", "values", "why"),
    [
        ((), 2, "2 values of position for 0 names"),
        (("hip", "hip"), 2, "a name appears twice among hip, hip"),
        (("trunk",), 2, "2 values of position for 1 names"),
        (("hip", "trunk", "hip"), 3, "a name appears twice among hip, trunk, hip"),
    ],
)
@pytest.mark.parametrize(
    "verb",
    [["metrics"], ["plot", "-o", "a.png"], ["report", "-o", "a.html"]],
)
def test_why_no_message_can_be_read_comes_first(
    tmp_path, monkeypatch, trunk, verb, names, values, why
):
    monkeypatch.chdir(tmp_path)
    path = states(tmp_path / "a.mcap", range(0, 20 * MS, MS), names, values)
    code, out, err = trunk(verb[0], path, *verb[1:])
    last = err.splitlines()[-1]
    assert (code, last) == (
        2,
        f"trunk: error: {path}: {TRUTH}: none of its 20 messages can be read: {why}",
    ), out


@pytest.mark.parametrize(
    ("library", "name"), [("", "a program that gives no name"), ("x 1", "x 1")]
)
def test_a_strangers_file_is_not_said_to_have_ended_badly(tmp_path, trunk, library, name):
    layout = JointStateLayout(BOTH, 2)
    messages = [
        (TRUTH, k * MS, layout.pack(JointSample(k * MS, BOTH, (0.0, 0.0)))) for k in range(9)
    ]
    path = write_mcap(tmp_path / "a.mcap", messages, library=library)
    says = f"recorded by {name}: no trunk_end record says whether the run is complete"
    for verb in ("info", "verify", "doctor", "metrics"):
        _, out, err = trunk(verb, path)
        assert says in out + err
        assert "shut down" not in out + err
        assert "did not finish" not in out + err
