"""Each process of a run x each signal x each phase x both modes: what happens is what the table says.

A sixth of a selection runs each time; TRUNK_FAULTS=all python -m pytest tests/faults runs every cell.
"""

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import combinations, product
from pathlib import Path

import pytest

from trunk_recording.reader import Recording

from ..graph.peer import Peer
from ..graph.processes import Child, Children, until
from ..graph.recordings import assert_every_step, finished_file, states_in
from ..graph.verbs import said
from . import matrix
from .matrix import CELLS, MODES, PHASES, PROCESSES, RUNNING, SIGNALS, STARTING, STOPPING, Cell

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
PERIOD_NS = 5_000_000
HOLD_S = 1.5  # between SIGSTOP and SIGCONT
ALL = os.environ.get("TRUNK_FAULTS") == "all"
LONG_S = 3600  # more than any test waits for: such a run ends by its fault
OPTIONS = {"real time": (), "lock-step": ("--lockstep", "--speed", "1")}


def test_the_page_has_the_table() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page.count("<!-- generated: faults -->") == 1
    assert matrix.refreshed(page) == page, "run python -m tests.faults.matrix docs/faults.md"


def test_each_cell_has_one_row_and_the_selection_has_all_pairs() -> None:
    assert all(matrix.row_of(cell) for cell in CELLS)
    chosen = matrix.selection()
    assert len(set(chosen)) == len(chosen) <= 26
    values = (PROCESSES, SIGNALS, PHASES, MODES)
    for i, j in combinations(range(4), 2):
        pairs = {(cell[i], cell[j]) for cell in chosen if cell.signal != matrix.ORPHANED}
        assert pairs == set(product(values[i], values[j]))
    assert any(cell.signal == matrix.ORPHANED for cell in chosen)


class Run:
    """A run of the demo, brought to the phase of a cell."""

    def __init__(self, cell: Cell, children: Children, peer: Peer) -> None:
        self.cell, self.children, self.peer = cell, children, peer
        self.row = matrix.row_of(cell)
        self.ends_by_fault = self.row.exit_code != 0
        self.duration = 2 if cell.phase != RUNNING else 6
        if self.ends_by_fault and cell.phase != STOPPING:
            self.duration = LONG_S
        self.folder = children.folder / "run"
        self.child: Child = children.trunk(
            *("run", "demo", "--duration", self.duration, "--output", "run"),
            *OPTIONS[cell.mode],
        )

    def reach(self) -> Callable[[int], None]:
        """Wait for the phase; return a function that sends the cell's process a signal."""
        return {STARTING: self._starting, RUNNING: self._running, STOPPING: self._stopping}[
            self.cell.phase
        ]()

    def _kill(self, pid: int) -> Callable[[int], None]:
        def kill(number: int) -> None:
            with suppress(ProcessLookupError):  # it has just ended: so be it
                os.kill(pid, number)

        return kill

    def _pid(self) -> int:
        process = self.cell.process
        return self.child.process.pid if process == "runner" else self.children.pid_of(process)

    def _starting(self) -> Callable[[int], None]:
        # Right after its exec: a node's imports take far longer than it takes to see this. The runner
        # has started all its nodes when the simulator, the last one, is there.
        self.children.pid_of("simulator" if self.cell.process == "runner" else self.cell.process)
        return self._kill(self._pid())

    def _running(self) -> Callable[[int], None]:
        pid = self._pid()
        self.peer.until_started(self.child)
        file = self.folder / "run.mcap"
        goes_on = self.child.process.poll
        until(lambda: goes_on() is not None or states_in(file) > 50, "50 states are on the disk")
        assert goes_on() is None, self.child.stderr
        return self._kill(pid)

    def _stopping(self) -> Callable[[int], None]:
        pid, simulator = self._pid(), self.children.pid_of("simulator")
        if self.cell.process == "simulator":
            log = self.folder / "logs" / "simulator.log"
            until(lambda: ": finished: " in log.read_text(), "the simulator has finished", 0.001)
        else:
            until(lambda: ended(simulator), "the simulator has ended", 0.001)
        return self._kill(pid)


def ended(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state in "ZX"


def logs(folder: Path) -> str:
    return "\n".join(path.read_text(errors="replace") for path in folder.glob("logs/*.log"))


@pytest.mark.graph
@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    "cell",
    CELLS if ALL else matrix.selection(),
    ids=str,
)
def test_cell(
    cell: Cell,
    children: Children,
    peer: Peer,
    record_property: Callable[[str, object], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if ALL:  # it is seen how long everything takes
        monkeypatch.setenv("TRUNK_PATIENCE", "1")
    run = Run(cell, children, peer)
    send = run.reach()
    began = time.monotonic()
    if cell.signal == matrix.ORPHANED:
        send(signal.SIGSTOP)
        run.child.send(signal.SIGKILL)
        until(lambda: len(children.pids()) <= 1, "all others have ended")
        send(signal.SIGCONT)
    else:
        send(getattr(signal, cell.signal))
    if cell.signal == matrix.SIGSTOP:
        time.sleep(HOLD_S)  # this is the fault itself
        send(signal.SIGCONT)
    code = run.child.wait()
    children.none_left()
    if cell.signal != matrix.SIGSTOP:
        record_property(matrix.TOOK, (str(cell), time.monotonic() - began))

    row, err, log = run.row, run.child.stderr, logs(run.folder)
    assert code == row.exit_code, err + log
    assert "Traceback" not in err + log
    if row.says:
        wanted = row.says.format(process=cell.process, signal=cell.signal)
        assert err.splitlines()[-1].startswith(f"trunk: error: {wanted}"), err
    else:
        assert "error" not in err
    CHECKS[row.recording](run, run.folder / "run.mcap")


def whole(run: Run, file: Path) -> None:
    finished_file(file)
    recording = Recording.open(file)
    assert recording.complete, recording.end
    assert recording.warnings == []
    assert_every_step(recording, PERIOD_NS, run.duration * 200 + 1)
    if run.cell.mode == "lock-step":  # the same bits as if nothing had happened
        offline = file.with_name("offline.mcap")
        simulated = said("simulate", "demo", "--duration", run.duration, "-o", offline)
        assert "401 states" in simulated or "1201 states" in simulated
        assert said("diff", offline, file).startswith("identical: ")


def incomplete(run: Run, file: Path) -> None:
    assert finished_file(file)["/ground_truth/joint_states"] > 50
    recording = Recording.open(file)
    assert not recording.complete
    assert recording.end is not None
    assert recording.end["reason"].startswith(run.row.reason)
    assert [w.startswith("incomplete: ") for w in recording.warnings] == [True]


def cut(run: Run, file: Path) -> None:
    recording = Recording.open(file)
    assert not recording.complete
    assert recording.end is None
    assert any("without a footer" in warning for warning in recording.warnings)
    assert recording.topics["/ground_truth/joint_states"].count > 50


def none_or_incomplete(run: Run, file: Path) -> None:
    if file.exists():
        recording = Recording.open(file)
        assert not recording.complete  # it may have begun by the time that the signal is heard


CHECKS = {
    matrix.Recording.WHOLE: whole,
    matrix.Recording.INCOMPLETE: incomplete,
    matrix.Recording.CUT: cut,
    matrix.Recording.NONE: none_or_incomplete,
}
