"""`Value`: what a parameter may hold, in a node, a file or a recording."""

from __future__ import annotations

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]
