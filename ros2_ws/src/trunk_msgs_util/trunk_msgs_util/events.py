"""`Event`: every event that a node publishes on ``run/events``."""

from __future__ import annotations

from enum import Enum


class Event(str, Enum):
    """The ``message`` of a status on ``run/events``; the node is its ``name``.

    A member is also a string, so that it compares equal to what a message or a file holds. The class
    is what the standard library calls a StrEnum from Python 3.11 on.
    """

    UNCONFIGURED = "unconfigured"
    CONFIGURED = "configured"
    ACTIVATED = "activated"
    DEACTIVATED = "deactivated"
    CLEANED_UP = "cleaned up"
    READY = "ready"
    STARTED = "started"
    RESET = "reset"
    RETUNED = "retuned"
    PAUSED = "paused"
    RESUMED = "resumed"
    FELL = "fell"
    CONNECTED = "connected"
    DISCONNECTED = "disconnected"
    REFUSED = "refused"
    PASSED_ON = "passed on"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"
    PUBLISHED = "published"

    __str__ = str.__str__


# Sent by the simulator, each of these ends the run.
ENDS = (Event.FINISHED, Event.STOPPED, Event.FAILED)

_DIGITS = 18  # of an integer of 64 bits; Python itself refuses to read thousands of them


def as_count(text: str) -> int:
    """Return the count that a value of an event gives; -1 if it is none."""
    return int(text) if text.isdecimal() and len(text) <= _DIGITS else -1
