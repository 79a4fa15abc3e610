"""`PlantInputs`: publishes what acts on the plant in each state, for the recorder."""

from __future__ import annotations

from trunk_msgs_util.node.conversions import sample_to_wire
from trunk_msgs_util.node.replayable import ReplayablePublisher

from .acting import Command, Disturbed, inputs_frame, inputs_row


class PlantInputs:
    """One row for each state, in their order."""

    def __init__(self, publisher: ReplayablePublisher) -> None:
        self._publisher = publisher
        self._last_ns = -1

    def publish(self, source: str, stamp_ns: int, command: Command, disturbed: Disturbed) -> None:
        """Publish a state's row, once: a plant that diverges has already published it as the run's last."""
        if stamp_ns <= self._last_ns:
            return
        self._last_ns = stamp_ns
        row = inputs_row(stamp_ns, command, disturbed)
        self._publisher.publish(sample_to_wire(row, inputs_frame(source, command, disturbed)))
