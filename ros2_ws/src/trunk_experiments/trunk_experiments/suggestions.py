"""Which name was meant: the closest of those that there are."""

from __future__ import annotations

from collections.abc import Iterable


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is most like ``name``, whatever its case; empty if none is."""
    from difflib import get_close_matches  # needed after a mistake

    by_lower = {one.lower(): one for one in known}
    found = get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'fig6'?``, or nothing where no known name is like it."""
    found = closest(name, known)
    return f"; did you mean {found!r}?" if found else ""
