"""``trunk plan``: one parameter file for all nodes of a run that are started elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import click

from trunk_core.text import shell_words
from trunk_runs.processes import connection_lines, launch_nodes
from trunk_runs.scenario import checked_namespace

from ..console.document import json_option, write_json
from ..console.options import (
    OutputResult,
    PlanResult,
    about_plan,
    check_output,
    external_option,
    files_read,
    output_options,
    plan_of,
    plan_options,
)


@dataclass(frozen=True)
class NodesResult(PlanResult, OutputResult, document="plan-1"):
    """The document of ``trunk plan``."""

    commands: Annotated[list[tuple[str, ...]], "How to start each node: the words of a command"]


@click.command("plan")
@plan_options()
@external_option
@output_options("The parameter file to write.  [default: params.yaml]")
@click.option(
    "--lockstep", is_flag=True, help="Step when every node has answered: the same bits each time."
)
@click.option("--namespace", default="", help="Namespace of all nodes, such as robot1.")
@json_option(NodesResult)
def command(
    output: Path | None,
    force: bool,
    lockstep: bool,
    namespace: str,
    as_json: bool,
    **options: Any,
) -> None:
    """Write the parameter file of a run of SCENARIO, and print how to start each of its nodes.

    The nodes may run on several hosts and in containers; each takes the same file.
    """
    everywhere: dict[str, object] = {"lockstep.enabled": True} if lockstep else {}
    target = check_output(
        output or Path("params.yaml"), (".yaml", ".yml"), force, files_read(options)
    )
    plan = plan_of(**options, extra=everywhere, namespace=checked_namespace(namespace))
    plan.write_parameters(target)
    commands = [
        ("ros2", "run", node.package, node.executable, "--ros-args", *node.ros_arguments)
        for node in launch_nodes(plan, target)
    ]
    if as_json:
        write_json(NodesResult(target, **vars(about_plan(plan)), commands=commands))
        return
    for words in commands:
        click.echo(shell_words(*words))
    for line in connection_lines(plan) if plan.external is not None else ():
        click.echo(f"# {line}")
