"""What the translations into FLL share: numbers, names, lines, bounds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

MOST_RULES = 20_000
MOST_TERMS = 10_000
_WORDS = frozenset(
    "if is then and or with not any very somewhat seldom extremely".split()  # noqa: SIM905
)


def number(text: str, place: str) -> float:
    """Return a number of a file. Raises ValueError for a text that is none, and for NaN."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{place}: {text[:30]!r} is not a number") from None
    if value != value:
        raise ValueError(f"{place}: NaN: every number must be given")
    return value


def numbers(text: str, place: str) -> list[float]:
    """Return numbers between spaces or commas. Raises what `number` does."""
    return [number(word, place) for word in text.replace(",", " ").split()]


def identifier(name: str) -> str:
    """Return a name as FLL has it, letters, digits and underscores, and no word of its grammar."""
    plain = "".join(letter for letter in name if letter.isalnum() or letter == "_") or "_"
    if plain[0].isnumeric():
        plain = f"_{plain}"
    return f"{plain}_" if plain.lower() in _WORDS else plain


def identifiers(names: Iterable[str]) -> list[str]:
    """Return the names as identifiers, each once: of equal ones the later get a number."""
    used: list[str] = []
    for name in map(identifier, names):
        unique, number_ = name, 2
        while unique in used:
            unique, number_ = f"{name}_{number_}", number_ + 1
        used.append(unique)
    return used


class Membership(NamedTuple):
    """A membership function in FLL: its name there, and which of a file's numbers are its parameters."""

    name: str
    order: tuple[int, ...]


def term_line(name: str, shape: str, parameters: Iterable[float]) -> str:
    """Return a term in FLL."""
    return f"  term: {name} {shape} {' '.join(map(repr, parameters))}".rstrip()
