"""``trunk info``: what is in a recording, whether it is complete, and with --check what is wrong with it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import click
from rich.filesize import decimal

from trunk_core import topics as names
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.results import Count, Keyword
from trunk_core.units import seconds
from trunk_evidence.doctor import ERROR, INFO, WARNING, Finding, findings
from trunk_evidence.doubts import RecordingResult, about, incomplete
from trunk_evidence.parameter_text import ChangedParameter, changed_parameters, lines_of
from trunk_evidence.recorded_run import RecordedRun, links_of
from trunk_recording.reader import Recording, Topic

from ..console.document import json_option, write_json
from ..console.reading import reading
from ..console.tables import aligned
from ..console.terminal import show_warnings

FINE, FINDINGS = 0, 1  # exit codes of --check
_WIDTH = 80


class TopicContent(NamedTuple):
    """A topic of a recording; times are the headers' stamps, gaps between log times."""

    type: str
    messages: Count
    rate_hz: float | None
    longest_gap_s: Annotated[float | None, "null: a single message, or not read"]
    bytes: Annotated[Count | None, "null: not read"]


@dataclass(frozen=True)
class InfoResult(RecordingResult, document="info-1"):
    """The document of ``trunk info``."""

    files: Annotated[Sequence[Path], Keyword("minItems", 1)]
    bytes: Count
    checked: Annotated[bool, "false: judged by its summary alone"]
    end: Annotated[Mapping[str, str] | None, "The recorder's last word; null: there is none"]
    warnings: Sequence[str]
    recorded_by: str | None
    duration_s: float | None
    scenario: str | None
    controllers: Sequence[str]
    provenance: Mapping[str, str]
    nodes: Sequence[str]
    changed: Annotated[Sequence[ChangedParameter], "What was changed while it ran, by time"]
    links: Annotated[Mapping[str, str], "What became of the messages of links; empty: none"]
    topics: Mapping[str, TopicContent]


def summary(run: RecordedRun) -> InfoResult:
    """Return a recording's content, and its doubts if all of it was read."""
    recording = run.recording
    # Of a large file only its summary is read.
    known = about(run) if recording.checked else RecordingResult(run.path, None)
    return InfoResult(
        **vars(known),
        files=recording.files,
        bytes=recording.size,
        checked=recording.checked,
        end=recording.end,
        warnings=recording.warnings,
        recorded_by=recording.library,
        duration_s=_duration(run),
        scenario=recording.provenance.get("scenario"),
        controllers=tuple(run.acting),
        provenance=recording.provenance,
        nodes=sorted(run.first_sets),
        changed=changed_parameters(run),
        links=links_of(run),
        topics={
            name: _topic(topic, recording.longest_gap_ns(name) if recording.checked else None)
            for name, topic in sorted(recording.topics.items())
        },
    )


def _topic(topic: Topic, gap_ns: int | None) -> TopicContent:
    first, last = topic.first_stamp_ns or 0, topic.last_stamp_ns or 0
    span = seconds(last - first)
    return TopicContent(
        topic.type,
        topic.count,
        (topic.count - 1) / span if span > 0.0 else None,
        seconds(gap_ns) if topic.count > 1 and gap_ns is not None else None,
        topic.size if gap_ns is not None else None,
    )


def _duration(run: RecordedRun) -> float | None:
    """Return the span of the true or measured states, or else of the longest topic, in s."""
    states = (
        run.recording.topics.get(run.topic(name))
        for name in (names.GROUND_TRUTH, names.JOINT_STATES)
    )
    best = next((topic for topic in states if topic is not None and topic.count), None)
    spans = [
        topic.last_stamp_ns - topic.first_stamp_ns
        for topic in ([best] if best else run.recording.topics.values())
        if topic.first_stamp_ns is not None and topic.last_stamp_ns is not None
    ]
    return seconds(max(spans)) if spans else None


def _pairs(values: Mapping[str, str]) -> list[str]:
    """Return names and values as lines of no more than 80 columns, where words allow it."""
    width = max(map(len, values), default=0) + 2
    return [
        line
        for name, value in values.items()
        for line in textwrap.wrap(
            f"{name:{width}}{value}",
            _WIDTH,
            subsequent_indent=" " * width,
            break_long_words=False,
            break_on_hyphens=False,
        )
    ]


def _state(content: InfoResult) -> str:
    """Return a word on a recording's completeness, and its source."""
    if content.checked and content.end is not None:
        return f"complete ({content.end['reason']})"
    return "complete by its summary; gaps, sizes and falls are not read: --check"


@dataclass(frozen=True)
class DoctorResult(RecordingResult, document="info-check-1"):
    """The document of ``trunk info --check``."""

    fine: Annotated[bool, "No finding but information"]
    findings: Sequence[Finding]


@click.command("info")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--check",
    is_flag=True,
    help="Read all of it, and report what is wrong: checksums, indexes, stamps, gaps, values, digests.",
)
@json_option(InfoResult, DoctorResult)
@click.pass_context
def command(context: click.Context, run: Path, check: bool, as_json: bool) -> None:
    """Show what is in a recording, an MCAP file or a rosbag2 folder, and whether it is complete.

    Long files are judged by their summaries, in an instant.

    Exit code of --check: 0 nothing wrong, 1 findings, 2 unreadable.
    """
    if check:
        context.exit(_checked(run, as_json))
    with reading(run) as tell:
        recording = Recording.open_by_summary(run, tell)
    recorded = RecordedRun(recording)
    content = summary(recorded)
    if as_json:
        write_json(content)
        return
    for line in content.doubts.lines if content.doubts else incomplete(recorded):
        click.echo(line)
    show_warnings(recording.further_warnings)
    files = f" in {len(content.files)} files" if len(content.files) > 1 else ""
    click.echo(f"{run}: {_state(content)}" if recording.complete else f"{run}")
    plant = recorded.parameters.get("simulator", {}).get(PLANT_NAME)
    overview = {
        "size": decimal(content.bytes) + files,
        "duration": "?" if content.duration_s is None else f"{content.duration_s:.10g} s",
        "scenario": content.scenario or "?",
        **({"plant": str(plant)} if plant else {}),
        "controller": ", ".join(content.controllers) or "none",
        "parameters of": ", ".join(content.nodes) or "no node",
        "recorded by": content.recorded_by or "?",
        **content.links,
    }
    click.echo("\n".join(["", *_pairs(overview), ""]))
    if changed := lines_of(content.changed):
        click.echo("\n".join(["changed while it ran:", *changed, ""]))
    rows = [
        (
            name,
            t.type.rsplit("/", 1)[-1],
            str(t.messages),
            "" if t.rate_hz is None else f"{t.rate_hz:.5g}",
            "" if t.longest_gap_s is None else f"{round(1e3 * t.longest_gap_s, 3):.12g}",
            "?" if t.bytes is None else decimal(t.bytes),
        )
        for name, t in content.topics.items()
    ]
    header = ("topic", "type", "messages", "rate, Hz", "gap, ms", "size")
    click.echo("\n".join([*aligned([header, *rows], texts=2), ""]))
    click.echo("\n".join(_pairs(content.provenance) or ["no provenance"]))


def exit_code(problems: list[Finding]) -> int:
    """Return 0 if there is nothing but information, 1 otherwise."""
    return FINDINGS if any(f.severity in (ERROR, WARNING) for f in problems) else FINE


def _checked(run: Path, as_json: bool) -> int:
    """Report what is wrong with a recording; return the exit code."""
    with reading(run, "examining") as tell:
        recorded = RecordedRun(Recording.open(run, tell, digests=True))
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
    return code
