"""`Event`: every event that a node publishes on ``run/events``."""

from __future__ import annotations

from enum import Enum


class Event(str, Enum):
    """The ``message`` of a status on ``run/events``; the node is its ``name``.

    A member is also a string, so that it compares equal to what a message or a file holds. The class
    is what the standard library calls a StrEnum from Python 3.11 on.
    """

    said_by: str
    meaning: str
    carries: tuple[str, ...]  # keys of the status' values, in order

    CONFIGURED = (
        "configured",
        "every node",
        "Its topics, services and files are open; `process` identifies its process, `kind` the kind of node",
        "process",
        "kind",
    )
    ACTIVATED = "activated", "every node", "It acts from the next state on"
    DEACTIVATED = "deactivated", "every node", "It holds from the next state on"
    CLEANED_UP = "cleaned up", "every node", "It has released its topics, services and files"
    READY = (
        "ready",
        "controllers, disturbance, recorder",
        "It is matched with the simulator and answers on the topic `answers`",
        "answers",
    )
    STARTED = (
        "started",
        "simulator",
        "All participants are ready; the first state follows. `rate` in Hz",
        "rate",
    )
    RESET = (
        "reset",
        "simulator, controllers",
        "Plant in its initial state; controller without integral and past samples",
    )
    RETUNED = (
        "retuned",
        "every node",
        "Parameters have changed: the next message of the node on `run/parameters` says which",
    )
    PAUSED = "paused", "simulator", "Simulated time stands still"
    RESUMED = "resumed", "simulator", "Simulated time continues"
    FELL = (
        "fell",
        "simulator",
        "The first state beyond the fall angle; `angle`, `limit` in rad",
        "angle",
        "limit",
    )
    CONNECTED = (
        "connected",
        "simulator",
        "A node of somebody else's publishes commands: its name, if it is a ROS node, and its DDS",
        "node",
        "middleware",
    )
    DISCONNECTED = (
        "disconnected",
        "simulator",
        "It publishes commands no longer",
        "node",
        "middleware",
    )
    REFUSED = (
        "refused",
        "every node",
        "The first message of a kind that the node does not use, and why; at its end, how many there were",
        "what",
        "why",
    )
    PASSED_ON = (
        "passed on",
        "simulator",
        "At the end of a run with links: what became of each link's messages, how many measurements failed",
        "link.state",
        "link.command",
        "sensor.dropout",
    )
    FINISHED = (
        "finished",
        "simulator",
        "All `states` are published; in real time `commanded` steps had a command, the last `silent` none",
        "reason",
        "states",
        "commanded",
        "silent",
    )
    STOPPED = (
        "stopped",
        "simulator",
        "The run was ended before its last state",
        "reason",
        "states",
        "commanded",
        "silent",
    )
    FAILED = (
        "failed",
        "every node",
        "The node ends with an error; only the simulator gives `states`",
        "reason",
        "states",
    )
    PUBLISHED = (
        "published",
        "simulator, controllers, disturbance",
        "It ends; the number of messages that it has published, by topic",
    )

    def __new__(cls, word: str, said_by: str, meaning: str, *carries: str) -> Event:
        """Make a member that is also its string."""
        event = str.__new__(cls, word)
        event._value_ = word
        event.said_by = said_by
        event.meaning = meaning
        event.carries = carries
        return event

    def __str__(self) -> str:
        return str(self.value)

    def __format__(self, spec: str) -> str:
        return format(self.value, spec)


# Sent by the simulator, each of these ends the run.
ENDS = (Event.FINISHED, Event.STOPPED, Event.FAILED)

_DIGITS = 18  # of an integer of 64 bits; Python itself refuses to read thousands of them


def as_count(text: str) -> int:
    """Return the count that a value of an event gives; -1 if it is none."""
    return int(text) if text.isdecimal() and len(text) <= _DIGITS else -1
