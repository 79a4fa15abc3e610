"""All edits of one recording, and what `trunk verify` says of each."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, KEPT, NONE, Content, content, write

from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util.recording.reader import RecordingError

from .accepted_edits import reason_for
from .event_edits import event_edits
from .file_edits import file_edits
from .joint_edits import joint_edits
from .messages import Edit
from .parameter_edits import parameter_edits

DIGESTS = (KEPT, ANEW, NONE)


class Outcome(NamedTuple):
    """What became of one edit."""

    base: str
    edit: Edit
    digests: str
    exit_code: int | None  # None: the edit changes nothing in this recording
    reason: str  # why it may pass; empty: it must not
    raised: str = ""

    @property
    def name(self) -> str:
        """Which edit of which recording, as the list of those let pass has it."""
        return f"{self.base}: {self.edit.kind}: {self.edit.name}"

    @property
    def wrong(self) -> str:
        """What is wrong with the outcome; empty: nothing."""
        if self.raised:
            return f"verify raised {self.raised}"
        if self.exit_code == VERIFIED and not self.reason:
            return "verified"
        return ""


def edits_of(found: Content) -> Iterator[Edit]:
    """Yield every edit that the kit knows for a recording."""
    yield from joint_edits(found)
    yield from event_edits(found)
    yield from parameter_edits(found)
    yield from file_edits(found)


def copy_of(found: Content) -> Content:
    """Return a copy whose parts can be changed."""
    return Content(
        found.profile,
        found.library,
        [list(message) for message in found.messages],
        [(name, dict(values)) for name, values in found.metadata],
        dict(found.channels),
        dict(found.schemas),
        list(found.attachments),
        dict(found.summed_up),
    )


def outcome(base: str, found: Content, edit: Edit, digests: str, folder: Path) -> Outcome:
    """Apply an edit to a copy, write it and let `verify` judge it."""
    edited = copy_of(found)
    done = edit.apply(edited)
    if done is False or edited == found:
        return Outcome(base, edit, digests, None, "")
    name = f"{base}: {edit.kind}: {edit.name}"
    reason = reason_for(name) if digests == ANEW else ""
    path = folder / "edited.mcap"
    try:
        code = verify(write(edited, path, digests)).exit_code
    except RecordingError as error:  # refused as a whole: another arithmetic
        code = error.exit_code
    except Exception as error:  # whatever it is: that is what is looked for
        return Outcome(base, edit, digests, 1, reason, f"{type(error).__name__}: {error}")
    return Outcome(base, edit, digests, code, reason)


def outcomes(
    base: str,
    path: Path,
    folder: Path,
    digests: tuple[str, ...] = DIGESTS,
    chosen: Callable[[Edit], bool] = lambda _: True,
) -> Iterator[Outcome]:
    """Yield what becomes of every edit of a recording."""
    found = content(path)
    for edit in edits_of(found):
        if chosen(edit):
            for kind in digests:
                yield outcome(base, found, edit, kind, folder)


def sample(share: float, seed: int = 1) -> Callable[[Edit], bool]:
    """Return a choice of edits, the same each time: each sort once, and a share of the others."""
    rng = random.Random(seed)
    seen: set[tuple[str, str]] = set()

    def chosen(edit: Edit) -> bool:
        _, comma, what = edit.name.rpartition(", ")
        sort = edit.kind, what if comma else ""
        first = share and sort not in seen
        seen.add(sort)
        return bool(first) or rng.random() < share

    return chosen


__all__ = ["ANEW", "DIGESTS", "KEPT", "NONE", "Outcome", "copy", "edits_of", "outcomes", "sample"]
