"""Whatever verifies is a right run: all it shows, its log and origin apart, is what the loop gives again."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from trunk_core.results import plain
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.repetition import plan_of
from trunk_evidence.run_table import all_columns, recorded_metrics
from trunk_experiments.commands.info import summary
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_views.report_data import report_data
from trunk_views.run_view import RunView

# Of `info`: the log, which nothing that is shown is computed from, and the file's own members.
_LOG = {"file", "files", "bytes", "checked", "end", "warnings", "recorded_by", "provenance"}
_LOG |= {"nodes", "topics"}
# Of doubts: what nodes noted, and what the recorder knew.
_NOTED = {"refused", "complete", "reason", "ends_at_s", "planned_s", "judged"}


def shown(run: RecordedRun) -> dict[str, str]:
    """Return all that is shown of a run, its log and origin apart, by its path."""
    info = plain(summary(run))
    info["doubts"] = {k: v for k, v in info["doubts"].items() if k not in _NOTED}
    view = RunView.read(run)
    columns = {
        name: np.asarray(c).tobytes().hex() for name, c in all_columns(run, view.table).items()
    }
    parameters = {node: v for node, v in run.parameters.items() if node != "recorder"}
    return dict(
        _flat(
            {
                "info": {name: value for name, value in info.items() if name not in _LOG},
                "metrics": plain(recorded_metrics(run)),
                "columns": columns,
                "report": report_data([view]),
                "title": view.title,
                "parameters": parameters,
            }
        )
    )


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{path}/{key}")
    else:  # 1 and 1.0 are one value
        whole = isinstance(value, int) and not isinstance(value, bool)
        yield path, repr(float(value) if whole else value)


def shown_otherwise(run: RecordedRun) -> list[str]:
    """Return what a verified run shows otherwise than its plan gives when it is run again."""
    again = run.path.with_suffix(".again.mcap")
    record_offline(plan_of(run), again, overwrite=True)
    one, other = shown(run), shown(RecordedRun(Recording.open(again, whole=True)))
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
