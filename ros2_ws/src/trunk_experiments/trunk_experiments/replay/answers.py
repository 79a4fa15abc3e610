"""What one process of a controller answered: its commands and terms, and which of them can be judged."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from math import nan

import numpy as np

from trunk_control.laws import law_named
from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.recording.joint_table import Bools, Floats, Integers
from trunk_msgs_util.recording.reader import RecordingError

from ..recorded.processes import Process, UnorderedError
from ..recorded.run import RecordedRun
from ..runs.states import TERMS
from .checks import MISSING, UNEXPECTED, Check, ComparedColumn, Difference

_MOST = 50  # processes: a double holds a bit for each that acts


class Answers:
    """A controller's process in a run, and the check of its commands and terms."""

    def __init__(self, run: RecordedRun, process: Process, label: str, period_ns: int) -> None:
        """``period_ns``: the plant's; 0 for another robot.

        Raises UnorderedError, and RecordingError for other messages.
        """
        self.process = process
        self.check = Check(f"commands of {label}")
        self.topic = topics.controller_state(process.node)
        self.lacking: Difference | None = None  # the first update without its terms
        commands, self._table = run.table(topics.EFFORT_COMMAND), run.table(self.topic)
        if len(self._table):
            self._table.check_width("position", len(law_named(process.node).record_names))
        # Rows of all commands and terms; None: they are all this process's.
        self._terms_rows = None if process.sent_all(self._table) else process.rows(self._table)
        self._terms_stamps = stamps = process.stamps(self._table)
        if (np.diff(stamps) <= 0).any():
            order = np.argsort(stamps, kind="stable")
            self._terms_rows = order if self._terms_rows is None else self._terms_rows[order]
            self._terms_stamps = stamps[order]
        self._rows = None if process.sent_all(commands) else process.rows(commands)
        self._stamps = process.stamps(commands)
        if not process.source and run.count(
            topics.PLANT_INPUTS
        ):  # a copy of a real-time run: its terms tell whose
            self._rows = np.flatnonzero(np.isin(self._stamps, self._terms_stamps))
            self._stamps = self._stamps[self._rows]
        self._known = True
        self._anew = list(_anew(process, period_ns))

    @property
    def idle(self) -> bool:
        """True for a process in real time of which no command is on record."""
        return bool(self.process.source) and not len(self._stamps)

    @property
    def last_ns(self) -> int:
        """The stamp of its last command on record, ns; -1 if there is none."""
        return int(self._stamps.max(initial=-1))

    def answered(self, stamps: Integers) -> Bools:
        """Return which states this process answered, by its own commands."""
        return np.isin(stamps, self._stamps)

    def last_update(self, stamp_ns: int) -> int:
        """Return the stamp of the last update up to a stamp, ns; -1 if there is none."""
        stamps = self._terms_stamps
        return int(stamps[stamps <= stamp_ns].max(initial=-1))

    def reference(self, stamp_ns: int) -> float:
        """Return the reference of the update with this stamp, rad; NaN if there is none."""
        there, values = self.terms_at(np.array([stamp_ns]))
        return float(values[0, 0]) if there[0] else nan

    def is_own(self, rows: Integers) -> Bools:
        """Return which of some commands, by their rows, are this process's."""
        return rows >= 0 if self._rows is None else np.isin(rows, self._rows)

    def terms_at(self, stamps: Integers) -> tuple[Bools, Floats]:
        """Return for which states there are terms, and which [n, K]; NaN where there are none."""
        known = self._terms_stamps
        values = np.full((len(stamps), len(self._table.names)), np.nan)
        there = np.zeros(len(stamps), bool)
        if not len(known):
            return there, values
        at = np.minimum(np.searchsorted(known, stamps), len(known) - 1)
        there = known[at] == stamps
        rows = at[there] if self._terms_rows is None else self._terms_rows[at[there]]
        if len(rows):
            first = int(rows.min())
            values[there] = self._table.positions(first, int(rows.max()) + 1)[rows - first]
        return there, values

    def lose(self) -> None:
        """Note that states are missing: what the controller did in them is not known."""
        self._known = False

    def is_known(self, stamps: Integers, readable: Bools, mine: Bools) -> Bools:
        """Return for which states the controller's memory follows from the record.

        ``readable``: there is a measured state; ``mine``: those that it answered, or all in simulated time.
        """
        lost = ~readable & (mine | (self.process.source == ""))
        if self._known and not lost.any():
            self._begin_anew(int(stamps[-1]))
            return readable
        known = np.zeros(len(stamps), bool)
        for row, stamp_ns in enumerate(stamps.tolist()):
            self._known = (self._known or self._begin_anew(stamp_ns)) and not lost[row]
            known[row] = self._known
        return known

    def begins_known(self, stamp_ns: int) -> bool:
        """Return True if the controller's memory before the state with this stamp follows from the record."""
        self._known = self._known or self._begin_anew(stamp_ns)
        return self._known

    def _begin_anew(self, stamp_ns: int) -> bool:
        """Return True if the controller began from nothing since it was last asked, before this stamp."""
        before = len(self._anew)
        self._anew = [since_ns for since_ns in self._anew if since_ns >= stamp_ns]
        return len(self._anew) < before

    def take(
        self,
        stamps: Integers,
        mine: Bools,
        given: Bools,
        known: Bools,
        effort: ComparedColumn | None,
        fresh: Bools,
        terms: tuple[Bools, Floats],
        table: Floats,
    ) -> None:
        """Compare the commands that are ``given`` in the rows that are ``mine``, and their terms.

        ``table``: as `States` has it.
        """
        self.check.unjudged += int(np.count_nonzero(mine & ~given))
        mine = mine & given
        if effort is None or not mine.any():
            return
        there, values = terms
        judged = mine & known
        blank = ~(there & fresh)
        names = self._table.names
        columns = [effort]
        for i, name in enumerate(names):
            recorded, own = values[:, i].copy(), table[:, TERMS + i].copy()
            recorded[blank] = own[blank] = 0.0
            columns.append(ComparedColumn(self.topic, f"position[{name}]", recorded, own))
        self.check.take(stamps[mine], judged[mine], [_rows_of(column, mine) for column in columns])
        for row in np.flatnonzero(judged & there & ~fresh)[:1].tolist():
            self.check.note(Difference(int(stamps[row]), self.topic, UNEXPECTED, 0.0, 0.0))
        lacking = np.flatnonzero(judged & fresh & ~there)
        if len(lacking) and self.lacking is None:
            self.lacking = Difference(int(stamps[lacking[0]]), self.topic, MISSING, 0.0, 0.0)


def _rows_of(column: ComparedColumn, rows: Bools) -> ComparedColumn:
    return column._replace(recorded=column.recorded[rows], computed=column.computed[rows])


def _anew(process: Process, period_ns: int) -> Iterator[int]:
    """Yield the stamps after which a controller starts from nothing, whatever it did before."""
    active = True
    for change in process.changes:
        if change.values is not None:
            continue
        begins = change.event == Event.RESET or (change.event == Event.ACTIVATED and not active)
        # A controller that joins a run under way begins just before the first state that it sees.
        joins = change.event == Event.ACTIVATED and change.stamp_ns > 0
        if begins or (joins and period_ns and (change.stamp_ns + 1) % period_ns == 0):
            yield change.stamp_ns
        active = change.event not in (Event.DEACTIVATED, Event.CLEANED_UP)


def answers_of(
    run: RecordedRun, processes: Sequence[Process], period_ns: int
) -> tuple[dict[str, Answers], list[Check]]:
    """Return the answers of each process by a label of its own, and the checks of those without order.

    Raises RecordingError for more processes than a run can have.
    """
    if len(processes) > _MOST:
        raise RecordingError(
            f"{run.path}: {len(processes)} processes of controllers: at most {_MOST} are run again"
        )
    answers: dict[str, Answers] = {}
    refused: list[Check] = []
    counts: Counter[str] = Counter()
    for process in processes:
        counts[process.node] += 1
        number = counts[process.node]
        label = process.node if number == 1 else f"{process.node}, process {number}"
        try:
            answers[label] = Answers(run, process, label, period_ns)
        except UnorderedError as error:  # it was killed, say: the others can be judged
            refused.append(Check(f"commands of {label}", reason=str(error)))
    return answers, refused
