"""Who takes part in a run: who is ready, who is missing, and that one controller acts at a time.

Pure: the functions passed in query the graph, and the time is an argument.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.topics import UNKNOWN_NODE

from .config import SimulatorConfig

# A participant that sends no events (another project's controller) counts as ready once it has been matched
# for this long; or for this long where it is not known to hear the states: `ros2 topic pub` never does, but
# on a bad link a node's events and subscriptions may be discovered much later than its commands.
_MATCHED_S, _DEAF_S = 1.0, 10.0
# DDS discovers a publisher first, then its node, then that node's events: after `strangers.UNNAMED_S` it is
# known whether there is one.
_STRANGER_S = 4.0


class Participants:
    """What the simulator knows about the other nodes, from the graph and from their events."""

    def __init__(
        self,
        config: SimulatorConfig,
        matched: Callable[[str], int],
        controllers: Callable[[], Sequence[str]],
        reporting: Callable[[str], Set[str]],
        hearing: Callable[[str], bool],
    ) -> None:
        """Take ``matched``, the number of a topic's publishers, and ``controllers``, those of commands.

        ``reporting``: those of a topic's publishers that send events, too; ``hearing``: whether one of them
        is known to subscribe to what it answers.
        """
        self._config = config
        self._matched = matched
        self._controllers = controllers
        self._reporting = reporting
        self._hearing = hearing
        self._heard: set[str] = set()  # nodes of which an event has arrived
        self._ready: dict[str, set[str]] = {}  # topic -> nodes that answer on it
        self._processes: dict[str, str] = {}  # node -> its process, as it reports it
        self._inactive: set[str] = set()
        self._unready: set[str] = set()  # were ready once but have reopened their topics since
        self._matched_since: dict[str, float] = {}
        self._met: set[str] = set()  # topics whose publishers were matched
        self._strange_since: float | None = None

    def hear(self, node: str, message: str, values: Mapping[str, str]) -> None:
        """Process a node's event on ``run/events``."""
        self._heard.add(node)
        if message == Event.CONFIGURED:
            self._processes[node] = values.get("process", "")
        if message == Event.READY and "answers" in values:
            self._ready.setdefault(values["answers"], set()).add(node)
            self._unready.discard(node)
        elif message == Event.ACTIVATED:
            self._inactive.discard(node)
        elif message in (Event.CONFIGURED, Event.DEACTIVATED, Event.CLEANED_UP):
            self._inactive.add(node)
            if message != Event.DEACTIVATED:
                self._unready.add(node)

    def missing(self, now: float) -> list[str]:
        """Return the topics, and the controllers, without which the run cannot begin; ``now`` in s."""
        missing = []
        for name in self._config.wait_for:
            if self._matched(name):
                waited = now - self._matched_since.setdefault(name, now)
            else:
                self._matched_since.pop(name, None)
                waited = 0.0
            if not self._may_answer(name, waited):
                missing.append(name)
        ready = {name.rsplit("/", 1)[-1] for name in self._ready_on(topics.EFFORT_COMMAND)}
        return missing + [name for name in self._config.controllers if name not in ready]

    def _may_answer(self, topic: str, waited: float) -> bool:
        """Return True if a node is ready on a topic that has been matched for ``waited`` s."""
        ready = self._ready_on(topic)
        # A node that was deactivated since must be activated again, unless it takes turns.
        turns = {name for name in ready if name.rsplit("/", 1)[-1] in self._config.controllers}
        if ready - self._inactive or turns:
            return True
        if self._reporting(topic) - self._heard:
            return False  # its events are under way, on a busy machine for longer
        if topic == topics.EFFORT_COMMAND:
            ready = set(self._controllers())
        needed = _MATCHED_S if self._hearing(topic) else _DEAF_S
        return waited >= needed and not (ready and ready <= self._inactive)

    def unmet(self, topic: str, matched: int, publishing: Set[str], listening: Set[str]) -> bool:
        """Return True if a node that is ready on a topic is not yet known to subscribe to what it answers.

        Its event may arrive before its publisher has a name, or before it is matched at all. If one was
        ``matched`` before and none is now, there is nothing left to wait for.
        """
        if matched:
            self._met.add(topic)
        elif topic in self._met:
            return False
        ready = self._ready_on(topic)
        here = ready & publishing
        return bool(ready) and not (here and here <= listening)

    def _ready_on(self, topic: str) -> set[str]:
        return self._ready.get(topic, set()) - self._unready

    def unsettled(self, now: float) -> bool:
        """Return True, for a bounded time, while the node of a publisher of commands is unknown."""
        names = self._controllers()
        if not _unnamed(names) and len(self._acting(names)) <= 1:
            self._strange_since = None
            return False
        if self._strange_since is None:
            self._strange_since = now
        return now - self._strange_since < _STRANGER_S

    def rivals(self) -> list[str]:
        """Return the nodes that act although only one may; none while one of them has no name yet."""
        names = self._controllers()
        acting = self._acting(names)
        return [] if _unnamed(names) or len(acting) <= 1 else acting

    def strangers(self) -> list[str]:
        """Return the publishers of commands that report nothing about themselves."""
        return [name for name in self._controllers() if name not in self._processes]

    def acting(self) -> list[str]:
        """Return the active publishers of commands; those that take turns count as one."""
        return self._acting(self._controllers())

    def _acting(self, names: Sequence[str]) -> list[str]:
        """Like `acting`, for names read once: discovery goes on, and a second read may differ."""
        turns = self._config.controllers
        seen: set[str] = set()
        acting: list[str] = []
        for name in sorted(names):
            own = name.rsplit("/", 1)[-1]
            if name in self._inactive:
                continue
            if own not in turns or own in seen or not seen:
                acting.append(name)
            if own in turns:
                seen.add(own)
        return acting

    def processes(self, topic: str) -> list[str]:
        """Return the processes of the nodes that answer on a topic, as far as they reported them."""
        ready = self._ready.get(topic, set())
        return sorted({self._processes[node] for node in ready if node in self._processes})

    def describe(self, topic: str) -> str:
        """Return who answers on a topic, as text for a message."""
        ready = self._ready.get(topic, set())
        answering = ready - self._inactive
        strangers = self.strangers() if topic == topics.EFFORT_COMMAND and not ready else []
        names = " or ".join(sorted(answering or ready) or strangers) or "anyone"
        return f"{names} ({topic}{'; inactive' if ready and not answering else ''})"


def _unnamed(names: Sequence[str]) -> bool:
    """Return True if a publisher of commands is discovered but its node is not."""
    return any(name.endswith(UNKNOWN_NODE) for name in names)
