"""What the verbs that apply a conformance kit share: the checks of a plug-in, as documents and a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import click

from trunk_core.errors import EXIT_FAILED
from trunk_core.results import Keyword, Result

from ..conformance.kit import Finding, Kit, Plugin
from .document import write_json
from .tables import print_table


class Checked(NamedTuple):
    """A check, and what it found."""

    name: str
    asserts: str
    kept: bool
    findings: Sequence[Finding]


@dataclass(frozen=True)
class CheckResult(Result, document="check-1"):
    """The document of ``trunk controller check``."""

    controller: str
    label: str
    package: str
    kept: Annotated[bool, "Every check is kept"]
    checks: Annotated[Sequence[Checked], Keyword("minItems", 1)]


@dataclass(frozen=True)
class PlantCheckResult(Result, document="check-plant-1"):
    """The document of ``trunk plant check``."""

    plant: str
    label: str
    package: str
    kept: Annotated[bool, "Every check is kept"]
    checks: Annotated[Sequence[Checked], Keyword("minItems", 1)]


def run_kit(
    kit: Kit[Plugin],
    kind: type[CheckResult | PlantCheckResult],
    name: str,
    label: str,
    package: str,
    as_json: bool,
) -> None:
    """Show a kit's checks of a registered plug-in; exit code 1 if one is not kept."""
    checks = checked(kit, name)
    kept = all(check.kept for check in checks)
    if as_json:
        write_json(kind(name, label, package, kept, checks))
    else:
        show_checked(label, package, checks)
    if not kept:
        click.get_current_context().exit(EXIT_FAILED)


def checked(kit: Kit[Plugin], name: str) -> list[Checked]:
    """Return a kit's checks of a registered plug-in; one is kept if it finds nothing but notes.

    Raises as `Kit.findings_of` does.
    """
    results = [(check, kit.findings_of(name, check)) for check in kit.checks]
    return [Checked(c.name, c.asserts, all(f.note for f in of), of) for c, of in results]


def show_checked(label: str, package: str, results: Sequence[Checked]) -> None:
    """Print a plug-in's checks as a table, and what they found, a line each."""
    words = [("noted" if c.findings else "kept") if c.kept else "NOT KEPT" for c in results]
    noted = f", {count} noted" if (count := words.count("noted")) else ""
    print_table(
        f"{label} ({package}): {words.count('kept')} of {len(words)} kept{noted}",
        ("check", "", "asserts"),
        [(c.name, word, c.asserts) for c, word in zip(results, words, strict=True)],
        texts=3,
    )
    checks_of: dict[Finding, list[str]] = {}  # of the same finding, by each of its checks
    for check in results:
        for finding in check.findings:
            checks_of.setdefault(finding._replace(check=""), []).append(check.name)
    for finding, checks in checks_of.items():
        line = finding._replace(check=", ".join(checks)).line()
        click.echo(f"note: {line}" if finding.note else line)
