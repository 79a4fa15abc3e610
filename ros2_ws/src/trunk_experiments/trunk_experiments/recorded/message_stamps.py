"""The stamps of recorded messages of any type: their headers', or else log times."""

from __future__ import annotations

import numpy as np

from trunk_msgs_util.recording.joint_table import Integers
from trunk_msgs_util.recording.mcap_file import McapFile
from trunk_msgs_util.recording.messages import Messages, unaligned
from trunk_msgs_util.recording.topic import STAMPED
from trunk_msgs_util.units import NANOSECONDS


def message_stamps(source: McapFile, messages: Messages, number: Integers) -> Integers:
    """Return each message's stamp in ns [N]; ``number`` [N] are their channels."""
    stamped = {c for c in np.unique(number).tolist() if source.type_of(c) in STAMPED}
    _, log, start, end = messages
    stamps = log.copy()
    rows = np.flatnonzero(np.isin(number, list(stamped)) & (end - start >= 12))
    octets = np.frombuffer(messages.data, np.uint8)
    for order, little in (("<", True), (">", False)):
        matching = rows[(octets[start[rows] + 1] == 1) == little]
        sec = unaligned(messages.data, f"{order}i4")[start[matching] + 4].astype(np.int64)
        stamps[matching] = (
            sec * NANOSECONDS + unaligned(messages.data, f"{order}u4")[start[matching] + 8]
        )
    return stamps
