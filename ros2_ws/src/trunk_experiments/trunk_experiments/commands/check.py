"""``trunk check``: whether a controller of your own does what every law promises."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from trunk_control.laws import LawError, law_named, package_of
from trunk_msgs_util.errors import EXIT_FAILED

from ..console.common import Name
from ..console.document import json_option, write_json
from ..console.tables import print_table
from ..console.verbs import Verbs
from ..plans.nodes import CONTROLLERS, UNUSABLE

if TYPE_CHECKING:
    from ..conformance import LawCheck, LawFinding


@click.group("check", cls=Verbs)
def command() -> None:
    """Check a controller: pure, finite, within limits, portable, compilable, replayable."""


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
