"""``trunk controller check``: whether a law of your own keeps the contract."""

from __future__ import annotations

from collections.abc import Sequence

import click

from trunk_control.laws import LawError, law_named, package_of
from trunk_msgs_util.errors import EXIT_FAILED

from ...conformance.law import CHECKS, LawCheck, LawFinding, findings_of
from ...console.document import json_option, write_json
from ...console.options import Name
from ...console.tables import print_table
from ...plans.nodes import CONTROLLERS, UNUSABLE


@click.command("check")
@click.argument("name", type=Name((*CONTROLLERS, *UNUSABLE)))
@json_option("check-1")
@click.pass_context
def command(ctx: click.Context, name: str, as_json: bool) -> None:
    """Apply the conformance kit to a registered controller; exit code 1 if anything is found."""
    if name in UNUSABLE:
        raise LawError(UNUSABLE[name])
    checked = [(check, findings_of(name, check)) for check in CHECKS]
    if as_json:
        write_json("check-1", as_values(name, checked))
    else:
        _show(name, checked)
    if not all(kept(findings) for _, findings in checked):
        ctx.exit(EXIT_FAILED)


def kept(findings: Sequence[LawFinding]) -> bool:
    """Return True if there is nothing but notes."""
    return all(finding.note for finding in findings)


def as_values(
    name: str, checked: Sequence[tuple[LawCheck, Sequence[LawFinding]]]
) -> dict[str, object]:
    """Return the checks of a controller and their findings as plain values."""
    return {
        "controller": name,
        "label": law_named(name).label,
        "package": package_of(name),
        "kept": all(kept(findings) for _, findings in checked),
        "checks": [
            {
                "name": check.name,
                "asserts": check.asserts,
                "kept": kept(findings),
                "findings": [
                    {"function": f.function, "what": f.problem, "advice": f.advice, "note": f.note}
                    for f in findings
                ],
            }
            for check, findings in checked
        ],
    }


def _show(name: str, checked: Sequence[tuple[LawCheck, Sequence[LawFinding]]]) -> None:
    count = sum(kept(findings) for _, findings in checked)
    print_table(
        f"{law_named(name).label} ({package_of(name)}): {count} of {len(checked)} kept",
        ("check", "", "asserts"),
        [
            (check.name, "kept" if kept(findings) else "NOT KEPT", check.asserts)
            for check, findings in checked
        ],
    )
    checks_of: dict[LawFinding, list[str]] = {}  # of the same finding, by each of its checks
    for _, findings in checked:
        for finding in findings:
            checks_of.setdefault(finding._replace(check=""), []).append(finding.check)
    for finding, checks in checks_of.items():
        line = finding._replace(check=", ".join(checks)).line()
        click.echo(f"note: {line}" if finding.note else line)
