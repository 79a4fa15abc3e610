"""A run refuses a second node of the same name in its domain; what discovery lists does not count."""

from __future__ import annotations

import os
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from trunk_experiments.runs.monitor_node import Monitor
from trunk_msgs_util.recording.reader import Recording

from ..graph.peer import Peer
from ..graph.processes import Children

pytestmark = pytest.mark.graph


@pytest.mark.parametrize("options", [(), ("--composed",)], ids=["processes", "composed"])
def test_second_node_of_a_name_is_refused(
    children: Children, peer: Peer, options: tuple[str, ...]
) -> None:
    other = children.node("disturbance")
    peer.until_event("disturbance", "configured")
    run = children.trunk("run", "demo", "--duration", 3600, "--output", "run", *options)
    assert run.wait() == 1
    # By the events that the run hears, or by its own node, which is refused.
    assert re.search(r"another /?disturbance is running.*: stop it", run.stderr.splitlines()[-1])
    assert other.stop() == 0


@pytest.mark.parametrize("verb", ["run", pytest.param("live", marks=pytest.mark.long)])
def test_a_second_run_is_refused_before_it_starts_anything(
    children: Children, peer: Peer, tmp_path: Path, verb: str
) -> None:
    first = children.trunk("run", "demo", "--duration", 3600, "--output", tmp_path / "first")
    peer.until_event("simulator", "started")
    page = ["--no-browser"] if verb == "live" else []
    second = children.trunk(verb, "demo", "--output", tmp_path / "second", *page)
    assert second.wait() == 1
    assert second.stderr == (
        f"trunk: error: another run is under way in ROS domain {os.environ['ROS_DOMAIN_ID']}, in process "
        f"{first.process.pid}: stop it or wait for its end, or set ROS_DOMAIN_ID to another number\n"
    )
    assert not (tmp_path / "second").exists()
    assert first.process.poll() is None
    first.stop()
    events = Recording.open(tmp_path / "first" / "run.mcap").events()
    assert [e.node for e in events if e.message == "configured"].count("/simulator") == 1


def test_a_node_is_doubled_by_its_events_not_by_discovery(domain: int) -> None:
    with Monitor() as monitor:
        node = monitor._node
        monitor._node = SimpleNamespace(get_fully_qualified_node_names=lambda: ["/simulator"] * 2)
        own = {"simulator": "boot.1.1", "recorder": "boot.2.2"}

        def says(name: str, process: str) -> None:
            values = [KeyValue(key="process", value=process)]
            status = DiagnosticStatus(name=name, message="configured", values=values)
            monitor._on_event(DiagnosticArray(status=[status]))

        for name, process in own.items():
            says(f"/{name}", process)
            says(f"/{name}", process)  # cleaned up and configured again
            says(f"/robot/{name}", "boot.3.3")  # in a namespace: another run's
        assert monitor.doubled(own) == []
        says("/recorder", "boot.4.4")
        assert monitor.doubled(own) == ["recorder"]
        monitor._node = node
