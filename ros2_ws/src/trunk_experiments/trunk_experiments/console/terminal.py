"""Where rich prints: colours and bars go past the filter that all other text passes through."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from trunk_msgs_util.printable import PrintableStream

if TYPE_CHECKING:
    from rich.console import Console


def console(stderr: bool = False) -> Console:
    """Return a console for stdout or stderr; text from elsewhere has to be made `printable` first."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    return Console(file=stream.stream if isinstance(stream, PrintableStream) else stream)
