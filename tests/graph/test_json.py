"""Documents of verbs that talk to ROS 2: nothing else is on stdout, not even what Fast DDS prints."""

import signal
from pathlib import Path
from typing import Any

import pytest
from ros2_ws.src.trunk_experiments.test.documents import checked

from .peer import Peer
from .processes import PATIENT, Child, Children

pytestmark = pytest.mark.graph


def document(child: Child, name: str) -> dict[str, Any]:
    """Return the document of a verb that has ended."""
    return checked((child.folder / f"{child.name}.out").read_text(), name)


def test_a_run_in_real_time_says_how_many_steps_were_late(
    children: Children, tmp_path: Path
) -> None:
    run = children.trunk(
        "run", "demo", "--composed", "--duration", 1, "-o", tmp_path / "a", "--json"
    )
    assert run.wait() == 0, run.stderr
    found = document(run, "run-1")
    assert found["failure"] is None
    assert found["doubts"]["complete"] is True
    assert found["doubts"]["late"]["of"] == found["states"] - 1 == 200
    assert found["metrics"]["iae"] > 0.0


def test_time_is_exact_in_lockstep(children: Children, tmp_path: Path) -> None:
    words = ("--lockstep", "--composed", "--duration", 0.1)
    run = children.trunk("run", "fig8", *words, "--output", tmp_path / "a", "--json")
    assert run.wait() == 0, run.stderr
    found = document(run, "run-1")
    assert (found["states"], found["doubts"]["late"]) == (101, None)


def test_a_stopped_run_still_gives_its_document(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    run = children.trunk(
        "run", "demo", "--composed", "--duration", 3600, "-o", tmp_path / "a", "--json"
    )
    peer.until_started(run)
    run.send(signal.SIGINT)
    assert run.wait() == 130, run.stderr
    found = document(run, "run-1")
    assert "stopped by SIGINT" in found["failure"]
    assert run.stderr.splitlines()[-1] == f"trunk: error: {found['failure']}"
    assert found["doubts"]["complete"] is False
    assert found["metrics"] is None


def test_parameters_of_a_running_node(children: Children, peer: Peer) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    words = ("pid", "pid_as_printed", "--json", *PATIENT)
    for count, applied in enumerate((False, True)):
        dry = () if applied else ("--dry-run",)
        child = children.trunk("params", "apply", *words, *dry, name=f"apply-{count}")
        assert child.wait() == 0, child.stderr
        found = document(child, "params-apply-1")
        assert (found["node"], found["applied"]) == ("/pid", applied)
        changes = {change["name"]: change for change in found["changes"]}
        assert (changes["gains.d"]["old"], changes["gains.d"]["new"]) == (9.0, 400.0)
    again = ("apply", *PATIENT, "pid", "pid_as_printed")
    child = children.trunk("params", "--json", *again, name="again")
    assert child.wait() == 0, child.stderr
    assert document(child, "params-apply-1")["changes"] == []
    changed = ("set", *PATIENT, "pid", "gains.p=50", "--json")
    child = children.trunk("params", *changed, name="set")
    assert child.wait() == 0, child.stderr
    (change,) = document(child, "params-apply-1")["changes"]
    assert change == {"name": "gains.p", "old": 60.0, "new": 50.0, "fixed": False}
    assert pid.stop() == 0, pid.stderr


def test_a_live_run_gives_the_addresses_of_its_page(
    children: Children, peer: Peer, tmp_path: Path
) -> None:
    child = children.trunk(
        "live", "demo", "--controller", "pid", "-o", tmp_path / "a", "--no-browser", "--json"
    )
    peer.until_started(child)
    child.send(signal.SIGINT)
    assert child.wait() == 0, child.stderr
    found = document(child, "page-1")
    assert found["recording"] == str(tmp_path / "a" / "run.mcap")
    assert found["address"] != found["watch_address"]
    for name, words in (("address", "page"), ("watch_address", "to watch only")):
        assert f"{words}: {found[name]}\n" in child.stderr
