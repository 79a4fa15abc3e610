"""Where a path leads."""

from __future__ import annotations

import os
from pathlib import Path


def real_path(path: Path) -> Path:
    """Return a path without links and dots; as far as it goes, for a link that leads to itself."""
    return Path(os.path.realpath(path))
