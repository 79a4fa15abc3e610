"""`Tally`: compares what was recorded of a run with what its nodes report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from .. import topics
from ..events import ENDS, Event, as_count
from ..recording.schemas import RunEvent

# One message for each state, by the simulator alone.
_OF_STATES = (topics.GROUND_TRUTH, topics.JOINT_STATES)


class Tally:
    """Counts a run's messages, hears its events, and tells whether the recording is whole."""

    def __init__(self, name_of: Callable[[str], str], of_each_state: Sequence[str] = ()) -> None:
        """``name_of`` gives a topic's absolute name; ``of_each_state``: topics that answer every state."""
        self._name_of = name_of
        self._of_each_state = of_each_state or _OF_STATES
        self.counts: Counter[str] = Counter()  # by relative topic
        self.runs = 1
        self.driven = False  # did a torque ever act on the plant?
        self.end: RunEvent | None = None
        self._kinds: dict[str, str] = {}  # of nodes, as they report them
        self._claimed: Counter[str] = Counter()  # by the nodes that have ended
        self._anew = False  # was a node cleaned up? its count then restarts
        self._disturbed = 0  # messages of disturbances that the simulator has taken
        self._states = 0  # of a finished run
        self._begun = 0  # runs, as the simulator reports them
        self._silent: dict[str, bool] = {}  # known nodes: has none of their events arrived?

    def hear(self, event: RunEvent) -> None:
        """Take an event. Raises ValueError for one that no node of ours sends."""
        self._silent[event.node] = False
        if event.message == Event.PUBLISHED:
            self._claimed.update({topic: _count(event, topic) for topic in event.values})
        self._anew |= event.message == Event.CLEANED_UP
        if event.message == Event.CONFIGURED:
            self._kinds[event.node] = event.values.get("kind", "")
        kind = self._kinds.get(event.node) or event.node.rpartition("/")[2]
        if kind == "simulator" and event.message == Event.DISTURBED:
            self._disturbed = _count(event, "disturbances")
        if kind == "simulator" and event.message in ENDS:
            if event.message == Event.FINISHED:
                self._states = _count(event, "states")
            self.end = event
        if kind == "simulator" and event.message == Event.STARTED:
            self.end = None  # the end of the run before is not this one's
            # Of a run before the recorder came, events and commands may be all that the file holds.
            self._begun += 1

    def meet(self, node: str) -> None:
        """Take note of a node that has published its parameters."""
        self._silent.setdefault(node, True)

    def uncounted(self, heard: Mapping[str, int]) -> list[str]:
        """Return where our nodes published more than they said when they ended, a line each.

        ``heard``: how many messages of our nodes there are, by topic. One that was killed, or outlives the
        recorder, has reported no count; if no node of the topic has, the file shows that.
        """
        if self._anew:
            return []
        return [
            f"{topic}: {count} messages from our nodes, which report {claimed}: "
            "not all of them reported a count"
            for topic, count in heard.items()
            if 0 < (claimed := self._claimed[self._name_of(topic)]) < count
        ]

    def verdict(self, heard: Sequence[str], unheard: Sequence[str]) -> tuple[bool, str]:
        """Return whether the run is whole in the file, and why.

        ``heard``: the topics whose evidence is to be complete; ``unheard``: what could not be heard, a line
        each.
        """
        if self.end is None:
            return False, "the recorder was stopped before the run was finished"
        reason = self.end.values.get("reason", self.end.message)
        if self.end.message != Event.FINISHED:
            return False, reason
        if (runs := max(self.runs, self._begun)) > 1:
            return False, f"it holds {runs} runs: the simulator was restarted"
        states = self._states
        for topic in self._of_each_state:
            if self.counts[topic] < states:
                return False, f"{topic}: {self.counts[topic]} of {states} messages were recorded"
        for topic in _OF_STATES:
            if self.counts[topic] > states:
                return False, (
                    f"{topic}: {self.counts[topic]} messages for {states} states: "
                    "another node publishes there too"
                )
        for topic in heard:
            # From one node only: the disturbance, a law's terms. Commands may also come from a stranger.
            count = self._claimed[self._name_of(topic)]
            pushes = topic == topics.OPERATOR_PUSH
            alone = pushes or topic == topics.DISTURBANCE or topics.is_controller_state(topic)
            # A simulator that was never pushed reports no count.
            if alone and not self._anew and (count or pushes) and count < self.counts[topic]:
                return False, (
                    f"{topic}: {self.counts[topic]} messages, {count} of them from its own node: "
                    "another node publishes there too"
                )
        if unheard:
            return False, "; ".join(unheard)
        if self.driven and not self.counts[topics.EFFORT_COMMAND]:
            return False, (
                f"{topics.EFFORT_COMMAND}: no message was recorded, but a torque acted on the plant: "
                "start the recorder before the controller"
            )
        for node, silent in self._silent.items():
            if silent:
                return False, f"{node}: its parameters were recorded, but none of its events"
        there = {self._name_of(topic): topic for topic in (*heard, *self.counts)}
        for name, count in self._claimed.items():  # what nodes said they had published
            topic = there.get(name, name.lstrip("/"))
            if self.counts[topic] < count:
                return False, f"{topic}: {self.counts[topic]} of {count} messages were recorded"
        if (count := self.counts[topics.DISTURBANCE]) < self._disturbed:
            return False, (
                f"{topics.DISTURBANCE}: {count} messages were recorded, but the simulator took "
                f"{self._disturbed}: the recorder lost some, or never met their node"
            )
        return True, reason


def _count(event: RunEvent, name: str) -> int:
    """Return a count that an event gives. Raises ValueError if it is none: no node of ours sent it."""
    count = as_count(event.values.get(name, ""))
    if count < 0:
        raise ValueError(f"{event.message} without a count of {name}")
    return count
