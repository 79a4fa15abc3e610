"""What happens when a process of a run gets a signal: the table that tests and docs/faults.md share.

``python -m tests.faults.matrix docs/faults.md`` writes the table into the page.
"""

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import product
from pathlib import Path
from signal import Signals
from typing import NamedTuple

CONTROLLER = "fuzzy_pid"
SIMULATOR, DISTURBANCE, RECORDER, RUNNER = "simulator", "disturbance", "recorder", "runner"
NODES = (SIMULATOR, DISTURBANCE, CONTROLLER, RECORDER)
PROCESSES = (*NODES, RUNNER)
SIGINT, SIGTERM, SIGKILL, SIGSTOP = "SIGINT", "SIGTERM", "SIGKILL", "SIGSTOP"
SIGNALS = (SIGINT, SIGTERM, SIGKILL, SIGSTOP)  # SIGSTOP: followed by SIGCONT
ORPHANED = "SIGSTOP, and the runner SIGKILL"
ASKING = (SIGINT, SIGTERM)
STARTING, RUNNING, STOPPING = "starting", "running", "stopping"
PHASES = (STARTING, RUNNING, STOPPING)
MODES = ("real time", "lock-step")
TOOK = "from the fault to the end of all processes, s"
PROMISE_S = 10.0


class Recording(Enum):
    """What is left of the recording, in the words of the page."""

    WHOLE = "complete"
    INCOMPLETE = "finished, incomplete"
    CUT = "cut: no end record, readable up to there"
    NONE = "none, or finished and incomplete"


class Cell(NamedTuple):
    """One case."""

    process: str
    signal: str
    phase: str
    mode: str

    def __str__(self) -> str:
        return "-".join("orphaned" if part == ORPHANED else part for part in self)


@dataclass(frozen=True)
class Row:
    """What happens in some cells: the run's exit code, its last line, the recording and its end reason.

    In the texts ``{process}`` and ``{signal}`` stand for the cell's.
    """

    phases: tuple[str, ...]
    processes: tuple[str, ...]
    signals: tuple[str, ...]
    exit_code: int
    says: str
    recording: Recording
    reason: str = ""

    def holds(self, cell: Cell) -> bool:
        return (
            cell.phase in self.phases
            and cell.process in self.processes
            and cell.signal in self.signals
        )


_LEFT = "the run ended because {process} ended with exit code 0"
_ENDED = "the run ended because {process} ended with exit code"  # 1 once it knows of the run's end
_CUT_SHORT = "the run ended because {process} ended with exit code 1"
_KILLED = "the run ended because {process} was ended by SIGKILL"
_STOPPED = "stopped by {signal}"  # perhaps before the run began
_TOLD = "stopped by {signal}; the recording holds the run up to here"
_EARLY = "stopped at t = "
_NO_END = "the recorder was stopped before the run was finished"

ROWS = (
    Row((STARTING,), (SIMULATOR, RECORDER), ASKING, 1, _ENDED, Recording.NONE),
    Row((STARTING,), (DISTURBANCE, CONTROLLER), ASKING, 1, _LEFT, Recording.NONE),
    Row((STARTING,), NODES, (SIGKILL,), 1, _KILLED, Recording.NONE),
    *(
        Row((STARTING,), (RUNNER,), (name,), 128 + Signals[name], _STOPPED, Recording.NONE)
        for name in ASKING
    ),
    Row((STARTING,), (RUNNER,), (SIGKILL,), -9, "", Recording.NONE),
    Row((RUNNING,), (SIMULATOR,), ASKING, 1, "simulator: " + _EARLY, Recording.INCOMPLETE, _EARLY),
    Row((RUNNING,), (SIMULATOR,), (SIGKILL,), 1, _KILLED, Recording.INCOMPLETE, _NO_END),
    Row((RUNNING,), (DISTURBANCE, CONTROLLER), ASKING, 1, _LEFT, Recording.INCOMPLETE, _EARLY),
    Row(
        (RUNNING,), (DISTURBANCE, CONTROLLER), (SIGKILL,), 1, _KILLED, Recording.INCOMPLETE, _EARLY
    ),
    Row((RUNNING,), (RECORDER,), ASKING, 1, _CUT_SHORT, Recording.INCOMPLETE, _NO_END),
    Row((RUNNING,), (RECORDER,), (SIGKILL,), 1, _KILLED, Recording.CUT),
    *(
        Row(
            (RUNNING,), (RUNNER,), (name,), 128 + Signals[name], _TOLD, Recording.INCOMPLETE, _EARLY
        )
        for name in ASKING
    ),
    Row((RUNNING,), (RUNNER,), (SIGKILL,), -9, "", Recording.INCOMPLETE),
    Row((STARTING, RUNNING), PROCESSES, (SIGSTOP,), 0, "", Recording.WHOLE),
    Row((STOPPING,), (SIMULATOR, DISTURBANCE, CONTROLLER), SIGNALS, 0, "", Recording.WHOLE),
    Row((STOPPING,), (RECORDER, RUNNER), (*ASKING, SIGSTOP), 0, "", Recording.WHOLE),
    Row(
        (STOPPING,),
        (RECORDER,),
        (SIGKILL,),
        1,
        "the recording is not whole: recorder was ended by SIGKILL",
        Recording.CUT,
    ),
    Row((STOPPING,), (RUNNER,), (SIGKILL,), -9, "", Recording.WHOLE),
    Row((STARTING,), NODES, (ORPHANED,), -9, "", Recording.NONE),
    Row((RUNNING,), NODES, (ORPHANED,), -9, "", Recording.INCOMPLETE),
)

CELLS = (
    *(Cell(*cell) for cell in product(PROCESSES, SIGNALS, PHASES, MODES)),
    *(Cell(*cell) for cell in product(NODES, (ORPHANED,), (STARTING, RUNNING), MODES)),
)


def row_of(cell: Cell) -> Row:
    """Return the one row that says what happens in a cell."""
    (row,) = (row for row in ROWS if row.holds(cell))
    return row


def selection() -> list[Cell]:
    """Return the cells for every day: each process running with each kind of signal, and all pairs.

    From process to process, SIGINT and SIGTERM alternate while it runs, and the other one is sent while it
    starts or stops; the modes alternate likewise.
    """
    chosen = []
    for p, process in enumerate(PROCESSES):
        asked, other = ASKING[p % 2], ASKING[1 - p % 2]
        for s, signal in enumerate((asked, SIGKILL, SIGSTOP)):
            chosen.append(Cell(process, signal, RUNNING, MODES[(p + s) % 2]))
        later = (STARTING, STOPPING) if p % 4 < 2 else (STOPPING, STARTING)
        chosen.append(Cell(process, other, later[0], MODES[p % 2]))
        chosen.append(Cell(process, (SIGKILL, SIGSTOP)[p % 2], later[1], MODES[(p + 1) % 2]))
    return [*chosen, Cell(RECORDER, ORPHANED, RUNNING, MODES[1])]


def _exit(row: Row) -> str:
    if row.exit_code < 0:
        return "ended by SIGKILL"
    return f"{row.exit_code}" + (f": *{_shown(row.says)} …*" if row.says else "")


def _shown(text: str) -> str:
    return text.format(process="NODE", signal="SIGNAL").split(";")[0].removesuffix(" = ")


def table() -> str:
    """Return all rows as a Markdown table."""
    lines = [
        "| while | who | gets | `trunk run` ends with | recording |",
        "|---|---|---|---|---|",
    ]
    for row in ROWS:
        who = "each node" if row.processes == NODES else ", ".join(row.processes)
        who = {PROCESSES: "anyone"}.get(row.processes, who).replace(CONTROLLER, "controller")
        signals = {SIGNALS: "any of the four"}.get(row.signals, ", ".join(row.signals))
        recording = row.recording.value
        if row.reason:
            recording += f": *{_shown(row.reason)}*"
        lines.append(
            f"| {' or '.join(row.phases)} | {who} | {signals} | {_exit(row)} | {recording} |"
        )
    return "\n".join(lines)


def times(taken: Mapping[str, float]) -> list[str]:
    """Return lines that say how long the end took, by cell, the longest first, and the worst of all."""
    worst = sorted(taken.items(), key=lambda item: -item[1])
    over = sum(seconds > PROMISE_S for seconds in taken.values())
    lines = [f"{seconds:6.2f} s  {cell}" for cell, seconds in worst]
    longest = f"every process had ended after at most {worst[0][1]:.2f} s"
    return [*lines, f"{longest}; {over} of {len(worst)} cells took over {PROMISE_S:g} s"]


def refreshed(page: str) -> str:
    """Return the page's text with the table made anew."""
    pattern = r"(<!-- generated: faults -->\n).*?(<!-- end -->)"
    return re.sub(pattern, lambda m: f"{m[1]}{table()}\n{m[2]}", page, flags=re.DOTALL)


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(refreshed(path.read_text(encoding="utf-8")), encoding="utf-8")
