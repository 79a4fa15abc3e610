"""``trunk info``: what is in a recording, and whether it is whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from trunk_msgs_util.recording import Recording
from trunk_msgs_util.units import seconds

from .common import print_table


def summary(recording: Recording) -> dict[str, Any]:
    """Return a recording's content as plain values."""
    topics = {}
    for name, topic in sorted(recording.topics.items()):
        first, last = topic.first_stamp_ns or 0, topic.last_stamp_ns or 0
        span = seconds(last - first)
        topics[name] = {
            "type": topic.type,
            "messages": topic.count,
            "rate_hz": (topic.count - 1) / span if span > 0.0 else None,
            "bytes": topic.size,
        }
    return {
        "file": str(recording.path),
        "bytes": recording.path.stat().st_size,
        "complete": recording.complete,
        "end": recording.end,
        "warnings": recording.warnings,
        "provenance": recording.provenance,
        "nodes": sorted(recording.parameters()),
        "topics": topics,
    }


@click.command("info")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(run: Path, as_json: bool) -> None:
    """Say what is in a recording, and whether it is whole."""
    found = summary(Recording.open(run))
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    for warning in found["warnings"]:
        click.echo(f"trunk: warning: {warning}", err=True)
    reason = (found["end"] or {}).get("reason", "no end marker")
    state = "complete" if found["complete"] else "INCOMPLETE"
    click.echo(f"{run}: {found['bytes']} bytes, {state} ({reason})")
    print_table(
        "topics",
        ("topic", "messages", "rate, Hz", "kB", "type"),
        [
            (
                name,
                str(t["messages"]),
                "" if t["rate_hz"] is None else f"{t['rate_hz']:.5g}",
                f"{t['bytes'] / 1000:.1f}",
                t["type"].replace("/msg/", "/"),
            )
            for name, t in found["topics"].items()
        ],
    )
    print_table("provenance", ("key", "value"), list(found["provenance"].items()))
    click.echo(f"parameters of {', '.join(found['nodes']) or 'no node'}")
