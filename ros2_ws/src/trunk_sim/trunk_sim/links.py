"""A network link: which messages it delays, loses, duplicates and reorders.

One message is sent in each step of the plant. `simulate_link` says, step by step, which of them the receiver
uses; that depends on the link's constants, the seed and the step alone, not on the messages' content.

Pure: functions of numbers, named tuples and arrays, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from math import floor
from typing import NamedTuple

from trunk_msgs_util.elementary import log
from trunk_msgs_util.recording.joint_arrays import Integers

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
