import ast
import re
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import declarations, values_of
from trunk_core.parameters.parameter_files import parse, read, resolve
from trunk_runs import processes
from trunk_runs.nodes import CONTROLLERS, NODES
from trunk_runs.plan import make_plan
from trunk_runs.processes import ARGUMENTS, launch_nodes, launch_plan
from trunk_runs.run_files import RunFiles
from trunk_runs.scenario import checked_namespace, shipped_files

PACKAGE = Path(__file__).parents[1]
LAUNCH_FILES = sorted((PACKAGE / "launch").glob("*.py"))


def given(**values):
    return {name: default for name, (default, _) in ARGUMENTS.items()} | values


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("scenario", ["fig6", "fig8"])
def test_the_nodes_are_those_of_trunk_run(scenario, controller, tmp_path):
    plan = launch_plan(given(scenario=scenario, controller=controller, lockstep="true"))
    nodes = launch_nodes(plan, tmp_path / "params.yaml")
    assert [node.executable for node in nodes] == list(plan.configs)
    assert (nodes[0].executable, nodes[-1].executable) == ("recorder", "simulator")
    assert [node.package for node in nodes] == [NODES[n.executable].package for n in nodes]
    assert plan == make_plan(scenario, controller, everywhere={"lockstep.enabled": True})


def test_arguments_make_the_same_plan_as_options():
    plan = launch_plan(
        given(
            scenario="fig8",
            controller="pid",
            params="pid_as_printed, profile_practical",
            lockstep="True",
        )
    )
    assert plan == make_plan(
        "fig8",
        "pid",
        ["pid_as_printed", "profile_practical"],
        everywhere={"lockstep.enabled": True},
    )


@pytest.mark.parametrize("namespace", ["", "robot1", "/left/robot1/"])
def test_each_node_finds_only_its_own_section(namespace, tmp_path):
    plan = make_plan("fig8", "fuzzy_pid", namespace=checked_namespace(namespace))
    plan = RunFiles.for_run(plan, tmp_path / "run").record(plan)
    layer = read(tmp_path / "run" / "params.yaml")
    for name, config in plan.configs.items():
        found = resolve(f"{plan.namespace}/{name}", [layer], declarations(type(config)))
        assert found == {
            k: list(v) if isinstance(v, tuple) else v for k, v in values_of(config).items()
        }
        assert resolve(f"/elsewhere/{name}", [layer], declarations(type(config))) == {}
    spaces = {f"__ns:={plan.namespace}" in n.ros_arguments for n in launch_nodes(plan, tmp_path)}
    assert spaces == {bool(namespace)}


def test_shipped_files_fit_nodes_in_any_namespace():
    for path in shipped_files().values():
        for section in read(path).sections:
            assert section.pattern.startswith("/**"), path


def test_relative_names_get_the_namespace_and_absolute_ones_do_not(tmp_path):
    text = "{}:\n  ros__parameters: {{gains: {{p: 7.0}}}}\n"
    for name, found in {"pid": 7.0, "/a/pid": 7.0, "/**/pid": 7.0, "/pid": 60.0}.items():
        path = tmp_path / "mine.yaml"
        path.write_text(text.format(name))
        plan = make_plan("demo", "pid", [str(path)], namespace="/a")
        assert plan.controller.p == found, name
    layer = parse(text.format("pid"), "mine")
    assert [s.pattern for s in layer.within("").sections] == ["pid"]  # rcl's short form


def test_the_simulator_stops_first_and_the_recorder_last():
    running = ["recorder", "pid", "disturbance", "simulator"]
    assert processes.next_to_stop(running) == ["simulator"]
    assert processes.next_to_stop(running[:3]) == ["pid", "disturbance"]
    assert processes.next_to_stop(running[:1]) == []


@pytest.mark.parametrize("code", [0, 1])
def test_a_launched_set_ends_in_that_order_and_says_why(monkeypatch, code):
    path = PACKAGE / "launch" / "trunk.launch.py"
    plain = MagicMock(
        EmitEvent=lambda event: event,
        LogInfo=lambda msg: msg,
        Shutdown=lambda reason: "end the launch",
        ShutdownProcess=lambda process_matcher: process_matcher,
        matches_action=lambda action: f"end {action}",
    )
    for name in re.findall(r"(?m)^from ((?:ament|launch)\S*)", path.read_text("utf-8")):
        monkeypatch.setitem(sys.modules, name, plain)
    monkeypatch.setattr(processes, "what_lacks", lambda file: "")
    end = runpy.run_path(str(path))["OrderlyEnd"](
        ["recorder", "pid", "disturbance", "simulator"],
        SimpleNamespace(recording="f", describe=str),
    )
    end.actions = dict(zip(end.running, end.running, strict=True))
    context = SimpleNamespace(is_shutdown=False)
    steps = [("pid", code), ("simulator", 0), ("disturbance", 0)]
    said = [end.on_exit(n)(SimpleNamespace(returncode=c), context) for n, c in steps]
    over = ["the run is over: f", "end the launch"]
    assert said == [["end simulator"], ["end disturbance"], over]
    context.is_shutdown, last = True, end.on_exit("recorder")
    if code:
        with pytest.raises(RuntimeError, match=r"^pid ended with exit code 1$"):
            last(SimpleNamespace(returncode=0), context)
    else:
        assert last(SimpleNamespace(returncode=0), context) == []


@pytest.mark.parametrize(
    "bad",
    [
        {"lockstep": "ja"},
        {"scenario": "fig5"},
        {"controller": "none"},
    ],
    ids=str,
)
def test_impossible_requests_are_refused_in_one_line(bad):
    with pytest.raises(PlanError) as caught:
        launch_plan(given(**bad))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda p: p.name)
def test_launch_files_compile_and_use_existing_names(path):
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    compile(tree, str(path), "exec")
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "processes"
    }
    assert {name for name in used if not hasattr(processes, name)} == set()
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert "generate_launch_description" in functions


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda p: p.name)
def test_launch_itself_loads_the_files(path):
    pytest.importorskip(
        "launch_ros.actions",
        reason="ROS 2's launch: with ROS 2 from apt, source /opt/ros/jazzy/setup.bash first",
    )
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    description = get_launch_description_from_python_launch_file(str(path))
    assert description.get_launch_arguments()
