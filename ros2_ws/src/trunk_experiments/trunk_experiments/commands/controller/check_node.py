"""``trunk controller check-node``: whether a running node, in any language, keeps the contract."""

from __future__ import annotations

from math import isfinite

import click

from trunk_msgs_util.errors import EXIT_FAILED

from ...console.document import json_option, write_json
from ...console.options import Number
from ...console.tables import print_table
from ...errors import PlanError
from ...plans.files import checked_namespace
from ...runs.node_processes import check_nodes_installed, claimed_domain


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
    type=click.FloatRange(0.0, 3600.0),
    default=10.0,
    show_default=True,
    help="How long to wait for it, s.",
)
@json_option("check-node-1")
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
    """Play states at a running node of anybody's, over the real graph, and judge what it answers.

    No simulator may run beside it. Exit code 1 if anything is found.
    """
    from ...conformance.node_judge import findings as findings_of
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
    if as_json:
        values = {
            "node": sender.name or None,
            "middleware": sender.middleware,
            "kept": not any(problem for _, problem in checked),
            "states": len(transcript.exchanges),
            "commands": len(efforts),
            "latency_ms": {"median": latencies.get("50 %"), "p999": latencies.get("99.9 %")},
            "largest_torque": largest if largest is not None and isfinite(largest) else None,
            "checks": [
                {
                    "name": check.name,
                    "asserts": check.asserts,
                    "kept": not problem,
                    "findings": [{"what": problem, "advice": check.advice}] if problem else [],
                }
                for check, problem in checked
            ],
        }
        write_json("check-node-1", values)
    else:
        count = sum(not problem for _, problem in checked)
        print_table(
            f"{sender.label} ({sender.middleware}): {count} of {len(checked)} kept",
            ("check", "", "asserts"),
            [
                (check.name, "NOT KEPT" if problem else "kept", check.asserts)
                for check, problem in checked
            ],
        )
        for check, problem in checked:
            if problem:
                click.echo(f"{check.name}: {problem}: {check.advice}")
        states, commands = len(transcript.exchanges), len(efforts)
        shown = ", ".join(f"{name} {value:.3g} ms" for name, value in latencies.items())
        click.echo(f"{commands} commands for {states} states; latency: {shown or 'not known'}")
    if any(problem for _, problem in checked):
        ctx.exit(EXIT_FAILED)
