"""`ros2 param load` and this project's commands read what `ros2 param dump` writes of a node."""

from math import inf
from pathlib import Path
from typing import Any

import pytest
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python

from trunk_core.parameters.declarations import values_of
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.processes import ARGUMENTS, launch_plan

from .peer import Peer
from .processes import Children

pytestmark = pytest.mark.graph

OWN = {
    "simulator": ("fall.angle:=.inf", "plant.trunk_mass:=0.75"),
    "disturbance": ("pulse.start_times:=[1.0e-05, 0.5]", "pulse.duration:=1.0e-05"),
    "fuzzy_pid": (
        "u_clamp_max:=.inf",
        "i_clamp_min:=-.inf",
        "gains.p_max:=70.0",
        "update_rate:=250.0",
    ),
    "recorder": ("scenario:='6'", "controllers:=[fuzzy_pid]"),
}


def dump(peer: Peer, node: str) -> str:
    """Return what `ros2 param dump` prints: ros2param/verb/dump.py."""
    listed = peer.call(ListParameters, f"/{node}/list_parameters")
    names = sorted(listed.result.names)
    got = peer.call(GetParameters, f"/{node}/get_parameters", names=names)
    tree: dict[str, Any] = {}
    for name, value in zip(names, got.values, strict=True):
        branch = tree
        *above, last = name.split(".")
        for key in above:
            branch = branch.setdefault(key, {})
        branch[last] = parameter_value_to_python(value)
    return yaml.dump({f"/{node}": {"ros__parameters": tree}}, default_flow_style=False)


def load(peer: Peer, node: str, file: Path) -> list[str]:
    """Do what `ros2 param load` does, and return why parameters are refused: ros2param/verb/load.py."""
    parameters = list(parameter_dict_from_yaml_file(str(file), True).values())
    response = peer.call(SetParameters, f"/{node}/set_parameters", parameters=parameters)
    assert len(response.results) == len(parameters)
    return [result.reason for result in response.results if not result.successful]


def as_given(plan: RunPlan) -> dict[str, object]:
    return {
        "fall": plan.simulator.fall_angle,
        "mass": plan.simulator.trunk_mass,
        "high": plan.controller.u_clamp_max,
        "low": plan.controller.i_clamp_min,
        "p": values_of(plan.controller)["gains.p_max"],
    }


def test_a_dump_is_loaded_and_makes_a_plan(children: Children, peer: Peer, tmp_path: Path) -> None:
    nodes = [children.node(name, "autostart:=false", *given) for name, given in OWN.items()]
    dumps = {}
    for name in OWN:
        peer.until_up(name)
        dumps[name] = dump(peer, name)
        (tmp_path / f"{name}.yaml").write_text(dumps[name])
    assert all("use_sim_time: false" in text for text in dumps.values())
    assert "u_clamp_max: .inf" in dumps["fuzzy_pid"]

    # Unchanged, it changes nothing and is not refused, fixed parameters included.
    for name, text in dumps.items():
        assert load(peer, name, tmp_path / f"{name}.yaml") == []
        assert dump(peer, name) == text
        peer.fresh_diagnostics(name)  # later than a change would have been published
    assert [p for p in peer.parameters if p.changed] == []

    # With another value, only this one changes; another value of a fixed parameter is refused.
    edited = dumps["fuzzy_pid"].replace("i_clamp_min: -.inf", "i_clamp_min: -1.0e-05")
    edited = edited.replace("update_rate: 250.0", "update_rate: 200.0")
    (tmp_path / "edited.yaml").write_text(edited)
    (reason,) = load(peer, "fuzzy_pid", tmp_path / "edited.yaml")
    assert "'update_rate': 200.0 is not allowed: fixed at start, to 250.0" in reason
    peer.until(lambda: [p for p in peer.parameters if p.changed], "the change is published")
    assert [p.changed for p in peer.parameters if p.changed] == [{"i_clamp_min": -1e-5}]
    assert load(peer, "fuzzy_pid", tmp_path / "fuzzy_pid.yaml") == []  # a limit back to -inf
    assert dump(peer, "fuzzy_pid") == dumps["fuzzy_pid"]

    # `--params`, `params:=` and a node itself.
    rates = "/**: {ros__parameters: {update_rate: 1000.0}}"  # the nodes above have their own
    (tmp_path / "rates.yaml").write_text(rates)
    files = [str(tmp_path / f"{name}.yaml") for name in (*OWN, "rates")]
    plan = make_plan("fig8", "fuzzy_pid", files)
    assert as_given(plan) == {"fall": inf, "mass": 0.75, "high": inf, "low": -inf, "p": 70.0}
    arguments = {name: default for name, (default, _) in ARGUMENTS.items()}
    launched = launch_plan({**arguments, "scenario": "fig8", "params": ",".join(files)})
    assert launched == plan
    assert nodes[2].stop() == 0
    again = children.node("fuzzy_pid", "--params-file", files[2], name="again")
    peer.parameters.clear()
    peer.until_up("fuzzy_pid")
    assert dump(peer, "fuzzy_pid") == dumps["fuzzy_pid"]
    for node in (nodes[0], nodes[1], nodes[3], again):
        assert node.stop() == 0
        assert "Traceback" not in node.stderr
