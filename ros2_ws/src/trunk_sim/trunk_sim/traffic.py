"""Which messages are in use at each step of a run: two links and the sensors' drop-outs, drawn from a seed.

A message is sent in each step each way: the reading that the sensors give, and the command that would act
on that step without a link. So nothing in the loop has to know about the links, and the seed tells
which readings a controller saw and which commands acted.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from trunk_msgs_util.compiled import twin
from trunk_msgs_util.recording.joint_arrays import Integers

from .links import DOUBLED, DRAWS, LATE, LOST, Link, most_late, simulate_link

# Streams of random integers of one seed.
_STATE, _COMMAND, _DROPOUT = range(3)
_BLOCK = 512  # steps that are drawn at a time, at first
_MOST = 1 << 16
_WORTH_COMPILING = 1 << 13  # steps
_AT_ONCE = 32  # steps that a node draws at a time

Value = TypeVar("Value")


class Network(NamedTuple):
    """What is between plant and controller, in one run."""

    state: Link
    command: Link
    zero: bool  # a step without a new command has no torque; else it has the last one's
    dropout: float  # probability that a reading fails; the previous one is then held
    seed: int
    period_ns: int


# Of the counts below, as events carry them.
_WORDS = ("sent", "lost", "late", "doubled", "overtaken")


class Counts(NamedTuple):
    """What became of a link's messages in a run."""

    sent: int
    lost: int
    late: int  # arrived, but not in the step in which they were sent
    doubled: int
    reordered: int  # a newer one arrived before or with them

    def describe(self) -> str:
        """Return the counts as an event carries them."""
        return ", ".join(f"{count} {word}" for word, count in zip(_WORDS, self, strict=True))


class Traffic:
    """The messages in use in each step; drawn on demand."""

    def __init__(self, network: Network, stepwise: bool = False) -> None:
        """``stepwise``: it is only asked for one step after the other, and forgets past steps."""
        self.network = network
        self._state, self._command = (
            _LinkTraffic(link, network, stream, stepwise)
            for link, stream in ((network.state, _STATE), (network.command, _COMMAND))
        )
        self._failures = _Failures(network, stepwise)

    def dropped(self, k: int) -> bool:
        """Return True if the reading of step k fails, and the one before it holds. The first never fails."""
        return bool(self._failures.at(k))

    def measurement_step(self, k: int) -> int:
        """Return the step whose reading is in use in step k; 0 until one has arrived."""
        return max(int(self._state.at(k)[_USED]), 0)

    def command_step(self, k: int) -> int:
        """Return the step whose command is in use in step k; -1 for none: no torque."""
        row = self._command.at(k)
        return -1 if self.network.zero and not row[_TAKEN] else int(row[_USED])

    def measurement_steps(self, steps: int) -> Integers:
        """Return the step whose reading is in use in each of ``steps`` steps [N], drop-outs included."""
        numbers = np.arange(steps)
        held = np.maximum.accumulate(np.where(self._failures.rows(steps), 0, numbers))
        steps_in_use: Integers = held[np.maximum(self._state.rows(steps)[:, _USED], 0)]
        return steps_in_use

    def command_steps(self, steps: int) -> Integers:
        """Return the step whose command is in use in each of ``steps`` steps [N]."""
        rows = self._command.rows(steps)
        if self.network.zero:
            return np.where(rows[:, _TAKEN], rows[:, _USED], -1)
        return rows[:, _USED].copy()

    def counts(self, steps: int) -> dict[str, str]:
        """Return the fate of the messages of the first ``steps`` steps, in words, by parameter group."""
        return {
            "link.state": self._state.counts(steps).describe(),
            "link.command": self._command.counts(steps).describe(),
            "sensor.dropout": str(int(self._failures.sums(steps)[0])),
        }


class InFlight(Generic[Value]):
    """The values that a link carries: those that may still arrive, and the one in use."""

    def __init__(self, link: Link, period_ns: int) -> None:
        self._longest = most_late(link, period_ns)
        self._sent: dict[int, Value] = {}
        self._used = -1

    def send(self, k: int, value: Value, used: int) -> Value:
        """Send the value of step k, and return that of step ``used``. Raises KeyError if it was not sent."""
        self._sent[k] = value
        if used != self._used:
            if self._used < k - self._longest:
                self._sent.pop(self._used, None)
            self._used = used
        old = k - self._longest - 1
        if old != used:
            self._sent.pop(old, None)
        return self._sent[used]


class _Drawn(ABC):
    """A row of numbers for each step, drawn in blocks; of forgotten rows, the sums remain."""

    def __init__(self, stepwise: bool, sums: int) -> None:
        self._stepwise = stepwise
        self._first = 0  # step of the first row that is kept
        self._rows: Integers = self._more(0, 0)
        self._past: Integers = np.zeros(sums, np.int64)

    @abstractmethod
    def _more(self, first: int, steps: int) -> Integers:
        """Return the rows of ``steps`` more steps, from ``first`` on."""

    @abstractmethod
    def _sums_of(self, rows: Integers) -> Integers:
        """Return the sums that these rows add."""

    def at(self, k: int) -> Integers:
        """Return the row of a step."""
        self._reach(k + 1)
        row: Integers = self._rows[k - self._first]
        return row

    def rows(self, steps: int) -> Integers:
        """Return the rows of the first ``steps`` steps."""
        self._reach(steps)
        return self._rows[:steps]

    def sums(self, steps: int) -> Integers:
        """Return the sums over the first ``steps`` steps."""
        self._reach(steps)
        return self._past + self._sums_of(self._rows[: steps - self._first])

    def _reach(self, steps: int) -> None:
        end = self._first + len(self._rows)
        if steps <= end:
            return
        if self._stepwise:
            self._past = self._past + self._sums_of(self._rows)
            self._first, self._rows = end, self._more(end, max(steps - end, _AT_ONCE))
        else:
            more = max(steps - end, min(max(end, _BLOCK), _MOST))
            self._rows = np.concatenate([self._rows, self._more(end, more)])


class _Failures(_Drawn):
    """1 where a reading fails."""

    def __init__(self, network: Network, stepwise: bool) -> None:
        self._network = network
        super().__init__(stepwise, 1)

    def _more(self, first: int, steps: int) -> Integers:
        drawn = _draw(self._network.seed, _DROPOUT, first, steps, 1)[:, 0] * 2.0**-53
        failed = (drawn < self._network.dropout).astype(np.int64)
        failed[: max(1 - first, 0)] = 0
        return failed

    def _sums_of(self, rows: Integers) -> Integers:
        return np.array([np.count_nonzero(rows)])


# Columns of a link's rows: the message in use, and what `simulate_link` puts in ``outcome``.
_USED, _FATE, _REORDERED, _TAKEN = range(4)


class _LinkTraffic(_Drawn):
    """One link."""

    def __init__(self, link: Link, network: Network, stream: int, stepwise: bool) -> None:
        self._link, self._period_ns = link, network.period_ns
        self._seed, self._stream = network.seed, stream
        self._memory = np.array([0, -1])
        self._due = np.zeros((most_late(link, network.period_ns) + 1, 2), np.int64)
        self._due[:, 0] = -1
        super().__init__(stepwise, 4)

    def _more(self, first: int, steps: int) -> Integers:
        bits = _draw(self._seed, self._stream, first, steps, DRAWS)
        rows = np.empty((steps, 4), np.int64)
        used, outcome = rows[:, _USED], rows[:, _FATE:]
        simulate = simulate_link if steps < _WORTH_COMPILING else twin(simulate_link)
        simulate(first, bits, self._link, self._period_ns, self._memory, self._due, used, outcome)
        return rows

    def _sums_of(self, rows: Integers) -> Integers:
        fates = rows[:, _FATE]
        counts = [np.count_nonzero(fates & bit) for bit in (LOST, LATE, DOUBLED)]
        return np.array([*counts, sum(rows[:, _REORDERED].tolist())])

    def counts(self, steps: int) -> Counts:
        """Return the fate of the messages of the first ``steps`` steps."""
        return Counts(steps, *self.sums(steps).tolist())


def _draw(seed: int, stream: int, first: int, steps: int, each: int) -> Integers:
    """Return random 53-bit integers of ``steps`` steps from ``first`` on [steps, each]."""
    generator = np.random.PCG64([seed, stream])
    generator.advance(each * first)
    raw = generator.random_raw(each * steps).reshape(steps, each)
    return (raw >> np.uint64(11)).astype(np.int64)
