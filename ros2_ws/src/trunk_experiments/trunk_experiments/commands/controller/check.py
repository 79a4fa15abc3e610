"""``trunk controller check``: whether a law of your own keeps the contract."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import click

from trunk_control.laws import LawError, law_named, package_of
from trunk_msgs_util.errors import EXIT_FAILED

from ...conformance.law import CHECKS, LawCheck, LawFinding, findings_of
from ...console.document import json_option, write_json
from ...console.options import Name
from ...console.tables import print_table
from ...plans.nodes import CONTROLLERS, UNUSABLE
from ...results import Keyword, Result


class CheckedLaw(NamedTuple):
    """A check of a law, and what it found."""

    name: str
    asserts: str
    kept: bool
    findings: Sequence[LawFinding]


@dataclass(frozen=True)
class CheckResult(Result, document="check-1"):
    """The document of ``trunk controller check``."""

    controller: str
    label: str
    package: str
    kept: Annotated[bool, "Every check is kept"]
    checks: Annotated[Sequence[CheckedLaw], Keyword("minItems", 1)]


@click.command("check")
@click.argument("name", type=Name((*CONTROLLERS, *UNUSABLE)))
@json_option(CheckResult)
@click.pass_context
def command(ctx: click.Context, name: str, as_json: bool) -> None:
    """Apply the conformance kit to a registered controller; exit code 1 if anything is found."""
    if name in UNUSABLE:
        raise LawError(UNUSABLE[name])
    checks = [_checked(name, check) for check in CHECKS]
    label, package, kept = law_named(name).label, package_of(name), all(c.kept for c in checks)
    result = CheckResult(name, label, package, kept, checks)
    if as_json:
        write_json(result)
    else:
        _show(result)
    if not kept:
        ctx.exit(EXIT_FAILED)


def _checked(name: str, check: LawCheck) -> CheckedLaw:
    """Return a check of a law with its findings; it is kept if there is nothing but notes."""
    findings = findings_of(name, check)
    return CheckedLaw(check.name, check.asserts, all(f.note for f in findings), findings)


def _show(result: CheckResult) -> None:
    words = [("noted" if c.findings else "kept") if c.kept else "NOT KEPT" for c in result.checks]
    noted = f", {count} noted" if (count := words.count("noted")) else ""
    print_table(
        f"{result.label} ({result.package}): {words.count('kept')} of {len(words)} kept{noted}",
        ("check", "", "asserts"),
        [(c.name, word, c.asserts) for c, word in zip(result.checks, words, strict=True)],
    )
    checks_of: dict[LawFinding, list[str]] = {}  # of the same finding, by each of its checks
    for check in result.checks:
        for finding in check.findings:
            checks_of.setdefault(finding._replace(check=""), []).append(finding.check)
    for finding, checks in checks_of.items():
        line = finding._replace(check=", ".join(checks)).line()
        click.echo(f"note: {line}" if finding.note else line)
