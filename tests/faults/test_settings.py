"""Settings that ROS 2 cannot use, for a run and for a node by hand: one line that names the setting."""

from __future__ import annotations

import pytest

from ..graph.processes import Children

pytestmark = pytest.mark.graph

SETTINGS = [
    ("ROS_DOMAIN_ID", "abc"),
    ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
    ("HOME", "/proc/none"),
    ("ROS_LOG_DIR", "/proc/none"),
]


@pytest.mark.parametrize(("name", "value"), SETTINGS)
def test_setting_is_named_in_one_line(
    children: Children, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    started = {
        "trunk": children.trunk("run", "demo", "--output", "run"),
        "simulator": children.node("simulator"),
    }
    for program, child in started.items():
        assert child.wait() == 2
        assert child.stderr.splitlines()[-1].startswith(f"{program}: error: {name}={value}")
        assert "Traceback" not in child.stderr
    assert len(started["simulator"].stderr.splitlines()) == 1
    assert list(children.folder.glob("run/logs/*")) == []
