"""The file that a recorder is told to write: its name is checked before anything is written."""

from __future__ import annotations

import time
from pathlib import Path

from ..parameters.config import RecorderConfig
from ..parameters.declarations import ParameterError
from ..recording.writer import RecordingWriter

_SUFFIX = ".mcap"


def open_output(config: RecorderConfig) -> RecordingWriter:
    """Create the file. Raises ParameterError if it cannot be written or already exists."""
    path = Path(config.output or time.strftime(f"trunk_%Y%m%dT%H%M%SZ{_SUFFIX}", time.gmtime()))
    if path.suffix.lower() != _SUFFIX and not path.is_relative_to("/dev"):
        raise _refused(path, f"the file's name must end in {_SUFFIX}, such as {path / 'run.mcap'}")
    try:
        return RecordingWriter(path, compression=config.compression, overwrite=config.overwrite)
    except FileExistsError:
        way_out = "it exists: give another name, or -p overwrite:=true to replace it"
        raise _refused(path, way_out) from None
    except OSError as error:
        raise _refused(path, f"a file to write ({error})") from None


def _refused(path: Path, allowed: str) -> ParameterError:
    return ParameterError("output", str(path), allowed)
