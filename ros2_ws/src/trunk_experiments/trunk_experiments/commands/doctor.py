"""``trunk doctor``: what is wrong with a recording, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import click

from trunk_msgs_util.recording.reader import Recording

from ..console.document import json_option, write_json
from ..console.reading import reading
from ..recorded.run import RecordedRun
from ..replay.doctor import ERROR, INFO, WARNING, Finding, findings
from ..replay.doubts import RecordingResult, about

FINE, FINDINGS = 0, 1


@dataclass(frozen=True)
class DoctorResult(RecordingResult, document="doctor-1"):
    """The document of ``trunk doctor``."""

    fine: Annotated[bool, "No finding but information"]
    findings: Sequence[Finding]


def exit_code(problems: list[Finding]) -> int:
    """Return 0 if there is nothing but information, 1 otherwise."""
    return FINDINGS if any(f.severity in (ERROR, WARNING) for f in problems) else FINE


@click.command("doctor")
@click.argument("run", type=click.Path(path_type=Path))
@json_option(DoctorResult)
@click.pass_context
def command(context: click.Context, run: Path, as_json: bool) -> None:
    """Report what is wrong with a recording: checksums, indexes, stamps, gaps, values, digests.

    Exit code: 0 nothing wrong, 1 findings, 2 unreadable.
    """
    with reading(run, "examining") as tell:
        recorded = RecordedRun(Recording.open(run, tell, whole=True))
        problems = findings(recorded)
    code = exit_code(problems)
    if as_json:
        write_json(DoctorResult(**vars(about(recorded)), fine=code == FINE, findings=problems))
    else:
        for finding in problems:
            click.echo(f"{finding.severity:7}  {finding.describe()}")
        counts = {s: sum(f.severity == s for f in problems) for s in (ERROR, WARNING, INFO)}
        counted = ", ".join(
            f"{n} {s}{'s' * (n != 1 and s != INFO)}" for s, n in counts.items() if n
        )
        click.echo(
            f"{run}: {'fine' if code == FINE else 'findings'}{f' ({counted})' if counted else ''}"
        )
    context.exit(code)
