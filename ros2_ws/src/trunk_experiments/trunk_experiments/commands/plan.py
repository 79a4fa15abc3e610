"""``trunk plan``: one parameter file for all nodes of a run that are started elsewhere."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import click

from ..console.common import plan_of, plan_options
from ..plans.plan import checked_namespace
from ..runs.launching import launch_nodes


@click.command("plan")
@plan_options
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("params.yaml"),
    show_default=True,
    help="The parameter file to write.",
)
@click.option(
    "--lockstep", is_flag=True, help="Step when every node has answered: the same bits each time."
)
@click.option("--namespace", default="", help="Namespace of all nodes, such as robot1.")
def command(output: Path, lockstep: bool, namespace: str, **options: Any) -> None:
    """Write the parameter file of a run of SCENARIO, and print how to start each of its nodes.

    The nodes may run on several hosts and in containers; each takes the same file.
    """
    everywhere: dict[str, object] = {"lockstep.enabled": True} if lockstep else {}
    plan = plan_of(**options, extra=everywhere, namespace=checked_namespace(namespace))
    plan.write_parameters(output)
    for node in launch_nodes(plan, output):
        words = ("ros2", "run", node.package, node.executable, "--ros-args", *node.ros_arguments)
        click.echo(shlex.join(words))
