"""What the translations into FLL share: numbers, names, lines, bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from trunk_core.text import plain_number

MOST_RULES = 20_000
MOST_TERMS = 10_000
_WORDS = frozenset(
    "if is then and or with not any very somewhat seldom extremely".split()  # noqa: SIM905
)


def number(text: str, place: str) -> float:
    """Return a number of a file. Raises ValueError for a text that is none, and for NaN."""
    try:
        value = plain_number(text)
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


# What a shape's numbers must be, in FLL's order; other programs refuse or read otherwise what is not.
_CONDITIONS: Mapping[str, tuple[str, Callable[..., bool]]] = {
    "Triangle": ("corners in ascending order", lambda a, b, c: a <= b <= c),
    "Trapezoid": ("corners in ascending order", lambda a, b, c, d: a <= b <= c <= d),
    "SShape": ("its start before its end", lambda a, b: a < b),
    "ZShape": ("its start before its end", lambda a, b: a < b),
    "PiShape": ("two slopes in ascending order", lambda a, b, c, d: a < b <= c < d),
    "Rectangle": ("its start before its end", lambda a, b: a < b),
    "SemiEllipse": ("its start before its end", lambda a, b: a < b),
    "Ramp": ("two different ends", lambda a, b: a != b),
    "Concave": ("two different points", lambda a, b: a != b),
    "Gaussian": ("a width that is not 0", lambda _, width: width != 0.0),
    "GaussianProduct": ("widths that are not 0", lambda _, a, __, b: a != 0.0 != b),
    "Bell": ("a width that is not 0", lambda _, width, __: width != 0.0),
    "Cosine": ("a width that is not 0", lambda _, width: width != 0.0),
    "Spike": ("a width that is not 0", lambda _, width: width != 0.0),
}


def checked_shape(shape: Membership, name: str, values: Sequence[float], place: str) -> list[float]:
    """Return a term's numbers in FLL's order. Raises ValueError for numbers that are not its shape's."""
    if len(values) != len(shape.order):
        raise ValueError(
            f"{place}: {name} takes {len(shape.order)} numbers; there are {len(values)}"
        )
    ordered = [values[k] for k in shape.order]
    needed, holds = _CONDITIONS.get(shape.name, ("", lambda *_: True))
    if not holds(*ordered):
        raise ValueError(f"{place}: {name} {' '.join(f'{v:g}' for v in values)}: give {needed}")
    return ordered


def put_once(pairs: dict[str, str], key: str, value: str, place: str) -> None:
    """Add a pair. Raises ValueError for a key that is there."""
    if key in pairs:
        raise ValueError(f"{place}: {key[:30]} is there twice")
    pairs[key] = value


def term_line(name: str, shape: str, parameters: Iterable[float]) -> str:
    """Return a term in FLL."""
    return f"  term: {name} {shape} {' '.join(map(repr, parameters))}".rstrip()
