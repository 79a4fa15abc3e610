"""``trunk check``: whether a controller of one's own keeps what every controller promises."""

from __future__ import annotations

import click

from trunk_control.laws import LawError, law_named, package_of
from trunk_msgs_util.errors import EXIT_FAILED

from ..console.common import Name
from ..console.tables import print_table
from ..plans.nodes import CONTROLLERS, UNUSABLE


@click.group("check")
def command() -> None:
    """Check a controller: pure, finite, within limits, portable, compilable, replayable."""


@command.command("controller")
@click.argument("name", type=Name((*CONTROLLERS, *UNUSABLE)))
@click.pass_context
def controller(ctx: click.Context, name: str) -> None:
    """Apply the conformance kit to a registered controller; exit code 1 if anything is found."""
    from ..conformance import CHECKS, findings_of

    if name in UNUSABLE:
        raise LawError(UNUSABLE[name])
    rows, lines = [], []
    for check in CHECKS:
        found = findings_of(name, check)
        kept = not any(not one.note for one in found)
        rows.append((check.name, "kept" if kept else "NOT KEPT", check.asserts))
        lines += [("note: " if one.note else "") + one.line() for one in found]
    law = law_named(name)
    print_table(
        f"{law.label} ({package_of(name)}): {sum(row[1] == 'kept' for row in rows)} of {len(rows)} kept",
        ("check", "", "asserts"),
        rows,
    )
    for line in lines:
        click.echo(line)
    if any(row[1] != "kept" for row in rows):
        ctx.exit(EXIT_FAILED)
