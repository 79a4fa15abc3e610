"""Which messages are in use at each step of a run: two links and the sensors' drop-outs, drawn from a seed.

A message is sent in each step each way: the reading that the sensors give, and the command that would act
on that step without a link. So nobody in the loop has to know of the links, and whoever knows the seed
knows which readings a controller saw and which commands acted.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Integers

from .links import DOUBLED, DRAWS, LATE, LOST, Link, most_late, pass_on

# Streams of random integers of one seed.
_STATE, _COMMAND, _DROPOUT = range(3)
_BLOCK = 512  # steps that are drawn at a time, at first
_MOST = 1 << 16
_WORTH_COMPILING = 1 << 13  # steps

Value = TypeVar("Value")


class Network(NamedTuple):
    """What is between plant and controller, in one run."""

    state: Link
    command: Link
    zero: bool  # a step without a new command has no torque; else it has the last one's
    dropout: float  # probability that a reading fails, and the one before it holds
    seed: int
    period_ns: int


class Counts(NamedTuple):
    """What became of a link's messages in a run."""

    sent: int
    lost: int
    late: int  # arrived, but not in the step in which they were sent
    doubled: int
    overtaken: int  # a newer one was there before them, or came with them

    def describe(self) -> str:
        """Return the counts as an event carries them."""
        return ", ".join(f"{count} {name}" for name, count in self._asdict().items())


class Traffic:
    """The messages in use in each step; drawn as far as they are asked for."""

    def __init__(self, network: Network) -> None:
        self.network = network
        period_ns = network.period_ns
        self._state = _Passed(network.state, period_ns, network.seed, _STATE)
        self._command = _Passed(network.command, period_ns, network.seed, _COMMAND)
        self._dropped = np.zeros(0, np.bool_)

    def dropped(self, k: int) -> bool:
        """Return True if the reading of a step fails: the one before it holds. The first never does."""
        if k >= len(self._dropped):
            self._drop(k + 1)
        return bool(self._dropped[k])

    def seen(self, k: int) -> int:
        """Return the step whose reading is in use in a step; until the first has arrived, it is that one."""
        return max(self._state.used_at(k), 0)

    def told(self, k: int) -> int:
        """Return the step whose command is in use in a step; -1 for none: no torque."""
        used = self._command.used_at(k)
        return -1 if self.network.zero and not self._command.taken_at(k) else used

    def all_seen(self, steps: int) -> Integers:
        """Return the step whose reading is seen in each of so many steps [N], drop-outs among them."""
        if steps > len(self._dropped):
            self._drop(steps)
        numbers = np.arange(steps)
        held = np.maximum.accumulate(np.where(self._dropped[:steps], 0, numbers))
        seen: Integers = held[np.maximum(self._state.used(steps), 0)]
        return seen

    def all_told(self, steps: int) -> Integers:
        """Return the step whose command is in use in each of so many steps [N]."""
        used = self._command.used(steps)
        if self.network.zero:
            used = np.where(self._command.taken(steps), used, -1)
        return used

    def counts(self, steps: int) -> dict[str, str]:
        """Return what became of the messages of so many steps, in words, by the parameters' groups."""
        self.dropped(steps - 1)
        return {
            "link.state": self._state.counts(steps).describe(),
            "link.command": self._command.counts(steps).describe(),
            "sensor.dropout": str(int(np.count_nonzero(self._dropped[:steps]))),
        }

    def _drop(self, steps: int) -> None:
        first = len(self._dropped)
        count = _next(first, steps) - first
        drawn = _draw(self.network.seed, _DROPOUT, first, count, 1)[:, 0] * 2.0**-53
        failed = drawn < self.network.dropout
        if first == 0:
            failed[0] = False
        self._dropped = np.concatenate([self._dropped, failed])


class InFlight(Generic[Value]):
    """The values that a link carries: those that may still arrive, and the one in use."""

    def __init__(self, link: Link, period_ns: int) -> None:
        self._longest = most_late(link, period_ns)
        self._sent: dict[int, Value] = {}
        self._used = -1

    def send(self, k: int, value: Value, used: int) -> Value | None:
        """Send the value of step k, and return that of the step in use; None if there is none."""
        self._sent[k] = value
        if used != self._used:
            if self._used < k - self._longest:
                self._sent.pop(self._used, None)
            self._used = used
        old = k - self._longest - 1
        if old != used:
            self._sent.pop(old, None)
        return self._sent.get(used)


class _Passed:
    """One link, step by step."""

    def __init__(self, link: Link, period_ns: int, seed: int, stream: int) -> None:
        self._link, self._period_ns = link, period_ns
        self._seed, self._stream = seed, stream
        self._memory = np.array([0, -1])
        self._due = np.zeros((most_late(link, period_ns) + 1, 2), np.int64)
        self._due[:, 0] = -1
        self._used: Integers = np.zeros(0, np.int64)
        self._told: Integers = np.zeros((0, 3), np.int64)

    def used_at(self, k: int) -> int:
        self._reach(k + 1)
        return int(self._used[k])

    def taken_at(self, k: int) -> bool:
        self._reach(k + 1)
        return bool(self._told[k, 2])

    def used(self, steps: int) -> Integers:
        self._reach(steps)
        return self._used[:steps]

    def taken(self, steps: int) -> Integers:
        self._reach(steps)
        return self._told[:steps, 2]

    def counts(self, steps: int) -> Counts:
        self._reach(steps)
        fates, overtaken = self._told[:steps, 0], self._told[:steps, 1]
        lost, late, doubled = (int(np.count_nonzero(fates & bit)) for bit in (LOST, LATE, DOUBLED))
        return Counts(steps, lost, late, doubled, sum(overtaken.tolist()))

    def _reach(self, steps: int) -> None:
        first = len(self._used)
        if steps <= first:
            return
        count = _next(first, steps) - first
        bits = _draw(self._seed, self._stream, first, count, DRAWS)
        used, told = np.empty(count, np.int64), np.empty((count, 3), np.int64)
        quick = pass_on if count < _WORTH_COMPILING else _compiled()
        quick(first, bits, self._link, self._period_ns, self._memory, self._due, used, told)
        self._used = np.concatenate([self._used, used])
        self._told = np.concatenate([self._told, told])


def _next(first: int, steps: int) -> int:
    """Return up to which step to draw: a block more each time, the blocks as long as what there is."""
    return max(steps, first + min(max(first, _BLOCK), _MOST))


def _draw(seed: int, stream: int, first: int, steps: int, each: int) -> Integers:
    """Return random integers of 53 bits of so many steps from ``first`` on [steps, each]."""
    generator = np.random.PCG64([seed, stream])
    generator.advance(each * first)
    raw = generator.random_raw(each * steps).reshape(steps, each)
    return (raw >> np.uint64(11)).astype(np.int64)


@cache
def _compiled() -> Callable[..., None]:
    try:
        from trunk_msgs_util.compiled import ready
    except ImportError:  # numba is not needed, but quick
        return pass_on
    none = np.zeros((0, DRAWS), np.int64)
    due = np.array([[-1, 0]])
    used, told = np.empty(0, np.int64), np.empty((0, 3), np.int64)
    return ready(pass_on, 0, none, Link(), 1, np.array([0, -1]), due, used, told)
