"""``trunk controller check-node``: whether a running node, in any language, keeps the contract."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, NamedTuple

import click

from trunk_msgs_util.errors import EXIT_FAILED
from trunk_msgs_util.node import middleware

from ...conformance.node_judge import findings as findings_of
from ...console.document import json_option, write_json
from ...console.options import FiniteRange, Number
from ...console.tables import print_table
from ...errors import PlanError
from ...plans.files import checked_namespace
from ...results import Keyword, Named, Result
from ...runs.node_processes import check_nodes_installed, claimed_domain


class NodeFinding(NamedTuple):
    """What a node does otherwise than it should, and what to write instead."""

    problem: Annotated[str, Named("what")]
    advice: str


class CheckedNode(NamedTuple):
    """A check of a node, and what it found."""

    name: str
    asserts: str
    kept: bool
    findings: Sequence[NodeFinding]


class Latency(NamedTuple):
    """From a state's publication to its answer, ms."""

    median: float | None
    p999: float | None


@dataclass(frozen=True)
class CheckNodeResult(Result, document="check-node-1"):
    """The document of ``trunk controller check-node``."""

    node: Annotated[str | None, "Its name; null: it is no ROS node"]
    middleware: Annotated[str, "Its DDS, as far as its identity tells"]
    kept: Annotated[bool, "Every check is kept"]
    states: int
    commands: int
    latency_ms: Annotated[Latency, "From a state's publication to its answer"]
    largest_torque: Annotated[float | None, "N m; null: none, or not finite"]
    checks: Annotated[Sequence[CheckedNode], Keyword("minItems", 1)]


@click.command("check-node")
@click.option("--namespace", default="", help="The node's namespace, such as robot1.")
@click.option(
    "--joint",
    default="trunk",
    show_default=True,
    help="The joint that it commands; the other is hip.",
)
@click.option(
    "--rate",
    type=Number("Hz"),
    default=200.0,
    show_default=True,
    metavar="HZ",
    help="Rate that the states' stamps have, Hz.",
)
@click.option(
    "--limit", type=Number("N m"), metavar="T", help="The largest torque that it may command, N m."
)
@click.option(
    "--wait",
    type=FiniteRange(0.0, 3600.0),
    default=10.0,
    show_default=True,
    help="How long to wait for it, s.",
)
@json_option(CheckNodeResult)
@click.pass_context
def command(
    ctx: click.Context,
    namespace: str,
    joint: str,
    rate: float,
    limit: float | None,
    wait: float,
    as_json: bool,
) -> None:
    """Play states at any running node, over the real graph, and judge what it answers.

    No simulator may run beside it. Exit code 1 if anything is found.
    """
    middleware.prepare()
    from ...conformance.player_node import Player

    if not rate > 0.0:
        raise PlanError(f"--rate {rate:g}: above 0 Hz is needed")
    check_nodes_installed()
    ctx.with_resource(claimed_domain())
    with Player(checked_namespace(namespace), ("hip", joint)) as player:
        sender = player.meet(wait)
        transcript = player.play(rate, sender, limit)
    checked = findings_of(transcript)
    times = transcript.latencies_s
    latencies = (
        {f"{q:g} %": 1e3 * times[int(q / 100.0 * (len(times) - 1))] for q in (50, 99.9)}
        if times
        else {}
    )
    efforts = [transcript.effort(answer.command) for _, answer in transcript.answers]
    largest = max((abs(effort) for effort in efforts if effort is not None), default=None)
    checks = [
        CheckedNode(
            check.name,
            check.asserts,
            not problem,
            [NodeFinding(problem, check.advice)] if problem else [],
        )
        for check, problem in checked
    ]
    kept = all(check.kept for check in checks)
    if as_json:
        result = CheckNodeResult(
            sender.name or None,
            sender.middleware,
            kept,
            len(transcript.exchanges),
            len(efforts),
            Latency(latencies.get("50 %"), latencies.get("99.9 %")),
            largest if largest is not None and isfinite(largest) else None,
            checks,
        )
        write_json(result)
    else:
        count = sum(check.kept for check in checks)
        print_table(
            f"{sender.label} ({sender.middleware}): {count} of {len(checks)} kept",
            ("check", "", "asserts"),
            [(c.name, "kept" if c.kept else "NOT KEPT", c.asserts) for c in checks],
        )
        for check, problem in checked:
            if problem:
                click.echo(f"{check.name}: {problem}: {check.advice}")
        states, commands = len(transcript.exchanges), len(efforts)
        shown = ", ".join(f"{name} {value:.3g} ms" for name, value in latencies.items())
        click.echo(f"{commands} commands for {states} states; latency: {shown or 'not known'}")
    if not kept:
        ctx.exit(EXIT_FAILED)
