"""Opening a recording for a verb: progress, warnings, and what every document says about a run."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from trunk_core import topics
from trunk_core.errors import TrunkError
from trunk_core.files import resolve_path
from trunk_core.results import Count
from trunk_evidence.doubts import RecordingResult, about, incomplete
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.reader import Recording

from .terminal import Tell, progress_bar, show_warnings

if TYPE_CHECKING:
    from trunk_views.run_view import RunView

_LONG = 100e6  # bytes, which take seconds to read


@dataclass(frozen=True)
class WrittenResult(RecordingResult):
    """What every document says about a recording just written."""

    states: Annotated[Count | None, "Recorded states; null: no file to read"]


def reading(path: Path, verb: str = "reading") -> AbstractContextManager[Tell]:
    """Show how much of a recording has been read; without a terminal, a short one prints no lines."""
    return progress_bar(f"{verb} {resolve_path(path).name}", _LONG)


def open_run(path: Path, whole: bool = False, digests: bool = False) -> RecordedRun:
    """Open a recorded run, as `Recording.open` does. Raises RecordingError."""
    with reading(path) as tell:
        return RecordedRun(Recording.open(path, tell, whole, digests))


def about_written(path: Path) -> WrittenResult:
    """Return the doubts and the number of states of a recording just written; None if unknown."""
    if path.is_file():  # not a pipe, or /dev/null
        with suppress(TrunkError):
            run = RecordedRun(Recording.open_by_summary(path))
            return WrittenResult(**vars(about(run)), states=run.count(topics.GROUND_TRUTH))
    return WrittenResult(path, None, None)


def open_views(paths: Iterable[Path]) -> list[RunView]:
    """Open runs that are to be shown. Raises RecordingError."""
    from trunk_views.run_view import RunView

    return [RunView.read(open_run(path, digests=True)) for path in paths]


def show_damage(run: RecordedRun, name: str = "") -> None:
    """Print to stderr that a run is not whole, then what is damaged; ``name`` begins each line."""
    show_warnings(f"{name}{line}" for line in (*incomplete(run), *run.recording.further_warnings))


def show_warnings_of(views: Iterable[RunView]) -> None:
    """Print to stderr what cannot be shown of these runs."""
    for view in views:
        show_warnings(f"{view.path}: {warning}" for warning in view.warnings)
