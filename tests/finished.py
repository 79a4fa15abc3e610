"""Commands that a test waits for."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def finished(
    command: Sequence[str | Path], check: bool = False, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Return a command that has ended, with its output as text; ``options``: of `subprocess.run`."""
    return subprocess.run(command, capture_output=True, text=True, check=check, **options)
