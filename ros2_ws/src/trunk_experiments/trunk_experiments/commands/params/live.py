"""``trunk params apply`` and ``set``: a running node's parameters, all at once or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import click

from trunk_msgs_util.node import middleware

from ...console.document import json_option, write_json
from ...console.options import FiniteRange, names_or_files, nodes, parameter_files
from ...live.parameters import LiveChange
from ...results import Result

_TIMEOUT = FiniteRange(min=0.0, min_open=True, max=3600.0, unit="s")


@dataclass(frozen=True)
class ParamsApplyResult(Result, document="params-apply-1"):
    """The document of ``trunk params apply``, set."""

    node: str
    applied: Annotated[bool, "false: --dry-run"]
    changes: Sequence[LiveChange]


def _live_options(function: Any) -> Any:
    for option in (
        click.option("--dry-run", is_flag=True, help="Show what differs; change nothing."),
        click.option(
            "--timeout",
            type=_TIMEOUT,
            default=5.0,
            show_default=True,
            metavar="S",
            help="How long the node may take to be found, and to answer.",
        ),
        json_option(ParamsApplyResult),
        click.option("--namespace", default="", help="Namespace of the node, such as robot1."),
    ):
        function = option(function)
    return function


@click.command("apply")
@click.argument("node", shell_complete=names_or_files(nodes))
@click.argument("file", shell_complete=names_or_files(parameter_files))
@_live_options
def apply(
    node: str, file: str, namespace: str, timeout: float, dry_run: bool, as_json: bool
) -> None:
    """Set the parameters of the running NODE to its values in FILE: all at once, or none.

    NODE is a node's name, such as pid or /robot2/pid; FILE a parameter file, by path or shipped name.
    """
    from trunk_msgs_util.parameters.files import read

    from ...errors import LiveParametersError
    from ...live.parameters import (
        choosers_of,
        differences,
        full_name,
        planned_names,
        said_in_si,
        said_of,
        with_numbers,
        with_tables,
    )
    from ...plans.files import checked_namespace, find_file

    layer, name = read(find_file(file)), full_name(node, checked_namespace(namespace))
    middleware.prepare()  # a middleware that is not there ends whoever imports rclpy
    from ...live.parameters_node import LiveParameters

    with LiveParameters(name, timeout) as parameters:
        said = said_of(name, layer, [*parameters.names(), *planned_names(name)])
        said = with_numbers(name, layer, said, parameters.values)
        said = with_tables(name, layer.source, said, parameters.values)
        present = parameters.values([*said, *choosers_of(name, said)])
        fixed = parameters.fixed(list(said))
        said = said_in_si(name, layer.source, said, present)
        changes = differences(said, present, fixed)
        refused = [change for change in changes if change.fixed]
        if refused and not dry_run:
            listed = "; ".join(map(str, refused))
            raise LiveParametersError(
                f"{name}: {listed}: nothing is changed; leave it out, or start the node with {file}"
            )
        if changes and not dry_run:
            parameters.set_together({change.name: change.new for change in changes})
    _say(name, changes, dry_run, as_json)


@click.command("set")
@click.argument("node", shell_complete=names_or_files(nodes))
@click.argument("settings", nargs=-1, required=True, metavar="NAME=VALUE...")
@_live_options
def set_values(
    node: str,
    settings: tuple[str, ...],
    namespace: str,
    timeout: float,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Set parameters of the running NODE: all at once, or none.

    NODE is a node's name, such as pid or /robot2/pid; VALUE is written as in a parameter file. If the
    node refuses, its own message is printed, and nothing has changed.
    """
    from trunk_msgs_util.parameters.files import Layer, Section

    from ...live.parameters import (
        choosers_of,
        differences,
        full_name,
        said_in_si,
        with_numbers,
        with_tables,
    )
    from ...plans.files import checked_namespace, settings_of

    wanted: Mapping[str, object] = settings_of(settings)
    name = full_name(node, checked_namespace(namespace))
    middleware.prepare()  # a middleware that is not there ends whoever imports rclpy
    from ...live.parameters_node import LiveParameters

    with LiveParameters(name, timeout) as parameters:
        given = Layer("params set", (Section(name, wanted),))
        wanted = with_numbers(name, given, wanted, parameters.values)
        wanted = with_tables(name, given.source, wanted, parameters.values)
        present = parameters.values([*wanted, *choosers_of(name, wanted)])
        fixed = parameters.fixed(list(wanted)) if dry_run else ()
        wanted = said_in_si(name, "params set", wanted, present)
        changes = differences(wanted, present, fixed)
        if changes and not dry_run:
            parameters.set_together({change.name: change.new for change in changes})
    _say(name, changes, dry_run, as_json)


def _say(node: str, changes: Sequence[LiveChange], dry_run: bool, as_json: bool) -> None:
    parent = click.get_current_context().parent
    if as_json or (parent is not None and parent.params["as_json"]):  # trunk params --json set
        write_json(ParamsApplyResult(node, not dry_run, changes))
        return
    for change in changes:
        click.echo(str(change))
    if not changes:
        click.echo("nothing to change")
