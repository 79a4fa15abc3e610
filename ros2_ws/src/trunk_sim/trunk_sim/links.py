"""The network links between plant and controller: which messages they delay, lose, duplicate and reorder.

A message is sent in each step of the plant, each way: the reading that the sensors give, and the command
that would act on that step without a link. `simulate_link` says, step by step, which of them the receiver
uses; that depends on the link's constants, the seed and the step alone, not on the messages' content. So
nothing in the loop has to know about the links, and the seed tells which readings a controller saw and
which commands acted.

Up to `simulate_link` pure: functions of numbers, named tuples and arrays, which CPython runs and numba
compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from trunk_core.arrays import Integers
from trunk_core.compiled import twin
from trunk_core.elementary import log

DRAWS = 6  # random integers of 53 bits in each step: burst, loss, delay; copy, its loss, its delay
MOST_LATE = 1_000_000  # steps; so many messages are kept
_UNIT = 2.0**-53
# What became of a message, in bits.
LOST, LATE, DOUBLED = 1, 2, 4


class Link(NamedTuple):
    """A link's constants; with the defaults, each message arrives at once."""

    delay: float = 0.0  # s, of every message
    jitter: float = 0.0  # s, random and added: its largest value, or its mean if exponential
    exponential: bool = False
    loss: float = 0.0  # probability, outside of bursts
    burst_begin: float = 0.0  # probability in each step
    burst_end: float = 1.0  # probability in each step
    burst_loss: float = 1.0  # probability, in a burst
    duplicates: float = 0.0  # probability
    latest: bool = True  # the receiver ignores what is older than what it has


def perfect(link: Link) -> bool:
    """Return True if every message arrives at once: the other constants then change nothing."""
    lossless = link.loss == 0.0 and (link.burst_begin == 0.0 or link.burst_loss == 0.0)
    return lossless and link.delay == 0.0 and link.jitter == 0.0


def delay_of(bits: int, link: Link) -> float:
    """Return the delay of a message in s, by 53 random bits.

    ``d + j p``, or ``d - j ln p`` if exponential, with ``p = (m + 1/2) 2^-52`` in (0, 1) of the highest 52
    bits m: uniform in d to d + j, or d and an exponential distribution of mean j.
    """
    p = (float(bits >> 1) + 0.5) * (2.0 * _UNIT)
    return link.delay - link.jitter * log(p) if link.exponential else link.delay + link.jitter * p


def steps_late(bits: int, link: Link, period_ns: int) -> int:
    """Return by how many steps a message is late: it is there at the first step not before its arrival.

    The delay is rounded to whole ns first.
    """
    delay_ns = floor(delay_of(bits, link) * 1e9 + 0.5)
    return -(-delay_ns // period_ns)


def most_late(link: Link, period_ns: int) -> int:
    """Return the largest number of steps by which a message can be late: with the smallest p."""
    return max(steps_late(bits, link, period_ns) for bits in (0, 2**53 - 1))


def chance(bits: int, probability: float) -> bool:
    """Return True for a share of all random integers of 53 bits."""
    return float(bits) * _UNIT < probability


def simulate_link(
    first: int,
    bits: Integers,
    link: Link,
    period_ns: int,
    memory: Integers,
    due: Integers,
    used: Integers,
    outcome: Integers,
) -> None:
    """Simulate a link: pass on the messages of N steps from ``first`` on.

    Bursts follow the two-state Gilbert-Elliott chain: each step may enter or leave the state in which
    messages are lost with ``burst_loss``; then the step's message is sent. A copy of it, if there is one,
    is lost or delayed independently.

    Of the messages that arrive at a step the receiver takes the newest; with ``latest``, only if it is
    newer than the one in use. ``bits`` [N, `DRAWS`] are random. ``used`` [N] gets the number of the
    message in use in each step, -1 before any. ``outcome`` [N, 3] gets what became of the step's message
    (bits), how many messages were reordered in the step (a newer one came before or with them), and 1
    where one was taken.

    ``memory`` [2] (1 in a burst; the message in use) and ``due`` [L, 2], with L above `most_late` (the newest
    message due in a step, -1 for none; how many it has passed), go on from call to call. Sources:
    E. N. Gilbert, Capacity of a burst-noise channel, Bell Syst. Tech. J. 39 (1960); E. O. Elliott, Estimates
    of error rates for codes on burst-noise channels, Bell Syst. Tech. J. 42 (1963).
    """
    for row in range(len(bits)):
        k = first + row
        burst = memory[0] == 1
        if chance(bits[row, 0], link.burst_end if burst else link.burst_begin):
            burst = not burst
        memory[0] = 1 if burst else 0
        loss = link.burst_loss if burst else link.loss
        fate = LOST | LATE
        copies = 1
        if link.duplicates > 0.0 and chance(bits[row, 3], link.duplicates):
            copies = 2
            fate |= DOUBLED
        for copy in range(copies):
            if not chance(bits[row, 1 + 3 * copy], loss):
                late = steps_late(bits[row, 2 + 3 * copy], link, period_ns)
                fate &= ~LOST if late > 0 else ~(LOST | LATE)
                slot = (k + late) % len(due)
                if due[slot, 0] >= 0 and due[slot, 0] != k:
                    due[slot, 1] += 1  # k is the newest so far
                due[slot, 0] = k
        if fate & LOST:
            fate &= ~LATE
        here = k % len(due)
        arrived, reordered = due[here, 0], due[here, 1]
        due[here, 0], due[here, 1] = -1, 0
        taken = 0
        if arrived >= 0:
            if arrived < memory[1]:
                reordered += 1
            if arrived > memory[1] or not link.latest:
                taken, memory[1] = 1, arrived
        used[row] = memory[1]
        outcome[row, 0], outcome[row, 1], outcome[row, 2] = fate, reordered, taken


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


# What becomes of a link's messages, as events count it. Late: not in use in the step in which they were sent;
# overtaken: a newer one arrived before or with them.
_WORDS = ("sent", "lost", "late", "doubled", "overtaken")


class Traffic:
    """The messages in use in each step; drawn on demand."""

    def __init__(self, network: Network, stepwise: bool = False) -> None:
        """``stepwise``: it is only asked for one step after the other, and forgets past steps."""
        self.network = network
        self._state, self._command = (
            _Drawn(_messages(link, network, stream), _fates, stepwise)
            for link, stream in ((network.state, _STATE), (network.command, _COMMAND))
        )
        self._failures = _Drawn(_failures(network), np.count_nonzero, stepwise)

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
        counts = {
            f"link.{name}": ", ".join(map("{} {}".format, (steps, *link.sums(steps)), _WORDS))
            for name, link in (("state", self._state), ("command", self._command))
        }
        return {**counts, "sensor.dropout": str(self._failures.sums(steps))}


class InFlight(Generic[Value]):
    """The values that a link carries: those that may still arrive, and the one in use."""

    def __init__(self, link: Link, period_ns: int) -> None:
        self._longest = most_late(link, period_ns)
        self._sent: dict[int, Value] = {}
        self._used = -1
        self._value: Value  # of step `_used`

    def send(self, k: int, value: Value, used: int) -> Value:
        """Send the value of step k, and return that of step ``used``. Raises KeyError if it was not sent."""
        self._sent[k] = value
        if used != self._used:
            self._used, self._value = used, self._sent[used]
        self._sent.pop(k - self._longest, None)
        return self._value


class _Drawn:
    """A row of numbers for each step, drawn in blocks; of forgotten rows, the sums remain."""

    def __init__(
        self,
        more: Callable[[int, int], Integers],
        sums_of: Callable[[Integers], Any],
        stepwise: bool,
    ) -> None:
        """``more``: returns rows, from a first step on so many; ``sums_of``: what rows add to the sums."""
        self._more, self._sums_of, self._stepwise = more, sums_of, stepwise
        self._first = 0  # step of the first row that is kept
        self._rows = more(0, 0)
        self._past = sums_of(self._rows)

    def at(self, k: int) -> Integers:
        """Return the row of a step."""
        self._reach(k + 1)
        row: Integers = self._rows[k - self._first]
        return row

    def rows(self, steps: int) -> Integers:
        """Return the rows of the first ``steps`` steps."""
        self._reach(steps)
        return self._rows[:steps]

    def sums(self, steps: int) -> Any:
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


def _failures(network: Network) -> Callable[[int, int], Integers]:
    """Return a function of a first step and how many: 1 where a reading fails."""

    def more(first: int, steps: int) -> Integers:
        drawn = _draw(network.seed, _DROPOUT, first, steps, 1)[:, 0] * 2.0**-53
        failed = (drawn < network.dropout).astype(np.int64)
        failed[: max(1 - first, 0)] = 0
        return failed

    return more


# Columns of a link's rows: the message in use, and what `simulate_link` puts in ``outcome``.
_USED, _FATE, _REORDERED, _TAKEN = range(4)


def _messages(link: Link, network: Network, stream: int) -> Callable[[int, int], Integers]:
    """Return a function that carries a link on: from a first step, for so many."""
    memory = np.array([0, -1])
    due = np.full((most_late(link, network.period_ns) + 1, 2), [-1, 0])

    def more(first: int, steps: int) -> Integers:
        bits = _draw(network.seed, stream, first, steps, DRAWS)
        rows = np.empty((steps, 4), np.int64)
        used, outcome = rows[:, _USED], rows[:, _FATE:]
        simulate = simulate_link if steps < _WORTH_COMPILING else twin(simulate_link)
        simulate(first, bits, link, network.period_ns, memory, due, used, outcome)
        return rows

    return more


def _fates(rows: Integers) -> Integers:
    """Return how many messages of a link were lost, late, doubled and reordered."""
    fates = rows[:, _FATE]
    counts = [np.count_nonzero(fates & bit) for bit in (LOST, LATE, DOUBLED)]
    return np.array([*counts, sum(rows[:, _REORDERED].tolist())])


def _draw(seed: int, stream: int, first: int, steps: int, each: int) -> Integers:
    """Return random 53-bit integers of ``steps`` steps from ``first`` on [steps, each]."""
    generator = np.random.PCG64([seed, stream])
    generator.advance(each * first)
    raw = generator.random_raw(each * steps).reshape(steps, each)
    return (raw >> np.uint64(11)).astype(np.int64)
