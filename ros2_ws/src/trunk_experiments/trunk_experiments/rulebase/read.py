"""A rule file as text in fuzzylite's language (FLL), into which the others are translated.

Bounded: a file's size, its number of rules and of terms; no NaN.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import RuleFileError
from .fcl import fcl_to_fll
from .fis import fis_to_fll
from .words import MOST_RULES, MOST_TERMS, put_once

LARGEST = 4_000_000  # bytes
_COMPONENTS = "Engine InputVariable OutputVariable RuleBlock".split()  # noqa: SIM905
_REPEATED = ("rule", "term")
_KEYS = (
    *(*_COMPONENTS, *_REPEATED, "description", "enabled", "range", "lock-range", "lock-previous"),
    *("aggregation", "defuzzifier", "default", "conjunction", "disjunction", "implication", "activation"),
)  # fmt: skip
_LOST = re.compile(rf"\s+(?=(?:{'|'.join(_KEYS)})\s*:)")


def checked_fll(text: str) -> str:
    """Return FLL with lost ends of lines. Raises ValueError for a line that pyfuzzylite would drop."""
    if "\n" not in text.strip():
        text = _LOST.sub("\n", text)
    seen: dict[str, str] = {}
    for line in text.splitlines():
        key, _, value = (word.strip() for word in line.partition("#")[0].partition(":"))
        if key in _COMPONENTS:
            seen.clear()
        elif key and not seen:
            raise ValueError(f"{key[:30]!r} stands before the first component: not a .fll file")
        if key and key not in _KEYS:
            raise ValueError(f"{key[:30]!r} is not a key of a .fll file")
        if key and key not in _REPEATED:
            put_once(seen, key, value, next(iter(seen), key))
    return text


TRANSLATIONS: Mapping[str, Callable[[str], str]] = {
    ".fis": fis_to_fll,
    ".fll": checked_fll,
    ".fcl": fcl_to_fll,
}


def read_fll(path: Path) -> str:
    """Return a rule file as FLL. Raises RuleFileError for one that cannot be used."""
    translate = TRANSLATIONS.get(path.suffix.lower())
    if translate is None:
        raise RuleFileError(f"{path}: the file's name must end in {', '.join(TRANSLATIONS)}")
    text = _text(path)
    try:
        fll = translate(text)
    except ValueError as error:
        raise RuleFileError(f"{path}: {error}") from None
    for word, most in (("rule", MOST_RULES), ("term", MOST_TERMS)):
        count = len(re.findall(rf"^\s*{word}\s*:", fll, re.MULTILINE))
        if count > most:
            raise RuleFileError(f"{path}: {count} {word}s: at most {most} are read")
    return fll


def _text(path: Path) -> str:
    if path.exists() and not path.is_file():  # reading a pipe would block
        raise RuleFileError(f"{path}: not a regular file: give a file of rules")
    with path.open("rb") as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise RuleFileError(f"{path}: more than {LARGEST / 1e6:g} MB: no rule file is that large")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if re.search(r"[\x00-\x08\x0e-\x1f\x7f-\x84\x86-\x9f]", text):
        raise RuleFileError(f"{path}: not a text in UTF-8 or Latin-1: save it as UTF-8")
    return re.sub("\r\n?", "\n", text)
