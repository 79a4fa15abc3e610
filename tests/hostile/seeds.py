"""Small recordings to begin fuzzing with: python -m tests.hostile.seeds FOLDER"""

import sys
from dataclasses import replace
from pathlib import Path

from mcap.records import Metadata
from ros2_ws.src.trunk_recording.test.mcap_files import (
    channel,
    chunk,
    content,
    message,
    record,
    schema,
    write_records,
)

from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

_STEPS = 3


def seeds(folder: Path) -> None:
    """Write a short run as it is, without compression and chunks, and with each kind of change."""
    base = folder / "whole.mcap"
    plan = make_plan("fig8", "pid")
    period = plan.simulator.period_ns / 1e9
    plan = replace(plan, simulator=replace(plan.simulator, duration=_STEPS * period))
    record_offline(plan, base, overwrite=True)
    run = content(base)
    described = b"".join(schema(number, kind.name) for number, kind in run.schemas.items())
    described += b"".join(channel(c.id, c.topic, c.schema_id) for c in run.channels.values())
    messages = b"".join(
        message(run.channels[topic].id, log, data) for topic, log, data, _, _ in run.messages
    )
    more = b"".join(record(Metadata(name, values)) for name, values in run.metadata)
    for name, records in (
        ("unchunked", [described + messages + more]),
        ("plain", [chunk(described + messages, compression=""), more]),
        ("zstd", [described, chunk(messages), more]),
    ):
        write_records(folder / f"{name}.mcap", *records, library="trunk_msgs_util")


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    seeds(Path(sys.argv[1]))
