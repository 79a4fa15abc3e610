"""``trunk check``: whether a controller of your own, a law or a running node, keeps the contract."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

import click

from trunk_control.laws import LawError, law_named, package_of
from trunk_msgs_util.errors import EXIT_FAILED

from ..console.common import Name, Number
from ..console.document import json_option, write_json
from ..console.tables import print_table
from ..console.verbs import Verbs
from ..errors import PlanError
from ..plans.given import checked_namespace
from ..plans.nodes import CONTROLLERS, UNUSABLE
from ..runs.domain_claim import claimed_domain
from ..runs.processes import check_nodes_installed

if TYPE_CHECKING:
    from ..conformance import LawCheck, LawFinding


@click.group("check", cls=Verbs)
def command() -> None:
    """Check a controller of your own: a law in Python, or a running node in any language."""


@command.command("controller")
@click.argument("name", type=Name((*CONTROLLERS, *UNUSABLE)))
@json_option("check-1")
@click.pass_context
def controller(ctx: click.Context, name: str, as_json: bool) -> None:
    """Apply the conformance kit to a registered controller; exit code 1 if anything is found."""
    from ..conformance import CHECKS, findings_of

    if name in UNUSABLE:
        raise LawError(UNUSABLE[name])
    done = [(check, findings_of(name, check)) for check in CHECKS]
    if as_json:
        write_json("check-1", as_values(name, done))
    else:
        _show(name, done)
    if not all(kept(found) for _, found in done):
        ctx.exit(EXIT_FAILED)


@command.command("node")
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
def node(
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
    from ..conformance.node_judge import findings
    from ..conformance.player_node import Player

    if not rate > 0.0:
        raise PlanError(f"--rate {rate:g}: above 0 Hz is needed")
    check_nodes_installed()
    ctx.with_resource(claimed_domain())
    with Player(checked_namespace(namespace), ("hip", joint)) as player:
        sender = player.meet(wait)
        transcript = player.play(rate, sender, limit)
    done = findings(transcript)
    times = transcript.latencies_s
    latencies = (
        {f"{q:g} %": 1e3 * times[int(q / 100.0 * (len(times) - 1))] for q in (50, 99.9)}
        if times
        else {}
    )
    largest = max(
        (abs(e) for c in transcript.commands if (e := transcript.effort(c)) is not None),
        default=None,
    )
    if as_json:
        values = {
            "node": sender.name or None,
            "middleware": sender.middleware,
            "kept": not any(found for _, found in done),
            "states": len(transcript.exchanges),
            "commands": len(transcript.commands),
            "latency_ms": {"median": latencies.get("50 %"), "p999": latencies.get("99.9 %")},
            "largest_torque": largest if largest is not None and isfinite(largest) else None,
            "checks": [
                {
                    "name": check.name,
                    "asserts": check.asserts,
                    "kept": not found,
                    "findings": [{"what": f.what, "advice": f.advice} for f in found],
                }
                for check, found in done
            ],
        }
        write_json("check-node-1", values)
    else:
        count = sum(not found for _, found in done)
        print_table(
            f"{sender.label} ({sender.middleware}): {count} of {len(done)} kept",
            ("check", "", "asserts"),
            [(check.name, "NOT KEPT" if found else "kept", check.asserts) for check, found in done],
        )
        for check, found in done:
            for one in found:
                click.echo(f"{check.name}: {one.what}: {one.advice}")
        states, commands = len(transcript.exchanges), len(transcript.commands)
        shown = ", ".join(f"{name} {value:.3g} ms" for name, value in latencies.items())
        click.echo(f"{commands} commands for {states} states; latency: {shown or 'not known'}")
    if any(found for _, found in done):
        ctx.exit(EXIT_FAILED)


def kept(found: Sequence[LawFinding]) -> bool:
    """Return True if there is nothing but notes."""
    return all(one.note for one in found)


def as_values(
    name: str, done: Sequence[tuple[LawCheck, Sequence[LawFinding]]]
) -> dict[str, object]:
    """Return the checks of a controller and what they found as plain values."""
    return {
        "controller": name,
        "label": law_named(name).label,
        "package": package_of(name),
        "kept": all(kept(found) for _, found in done),
        "checks": [
            {
                "name": check.name,
                "asserts": check.asserts,
                "kept": kept(found),
                "findings": [
                    {key: value for key, value in one._asdict().items() if key != "check"}
                    for one in found
                ],
            }
            for check, found in done
        ],
    }


def _show(name: str, done: Sequence[tuple[LawCheck, Sequence[LawFinding]]]) -> None:
    from ..conformance import LawFinding

    rows = [
        (check.name, "kept" if kept(found) else "NOT KEPT", check.asserts) for check, found in done
    ]
    count = sum(kept(found) for _, found in done)
    print_table(
        f"{law_named(name).label} ({package_of(name)}): {count} of {len(rows)} kept",
        ("check", "", "asserts"),
        rows,
    )
    met: dict[tuple[str, str, str, bool], list[str]] = {}
    for _, found in done:
        for one in found:
            met.setdefault((one.function, one.what, one.advice, one.note), []).append(one.check)
    for (function, what, advice, note), checks in met.items():
        one = LawFinding(", ".join(checks), function, what, advice, note)
        click.echo(("note: " if note else "") + one.line())
