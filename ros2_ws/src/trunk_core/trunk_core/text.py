"""Text from files, messages and nodes' names, made safe to print: it cannot drive the terminal."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from typing import Any, TextIO

# Control characters except tab and newline; separators and bidirectional marks; lone surrogates, as in names
# that are not text.
_UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)

LONGEST_MESSAGE = 480


def printable(text: str) -> str:
    r"""Return the text with each character that acts on a terminal written as JSON would: ``\u001b``."""
    return _UNPRINTABLE.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def shell_words(*words: str) -> str:
    """Return a command as it can be pasted into a shell, whatever bytes its files' names are made of."""
    return " ".join(map(_shell_word, words))


def _shell_word(word: str) -> str:
    if printable(word) == word:
        return shlex.quote(word)
    try:
        data = os.fsencode(word)
    except UnicodeEncodeError:  # no file has this name
        return shlex.quote(word)
    shown = (chr(b) if 32 <= b < 127 and b not in b"\\'" else f"\\x{b:02x}" for b in data)
    return f"$'{''.join(shown)}'"


def shortened(text: str, longest: int = 40) -> str:
    """Return a text as an error quotes it: of at most so many characters."""
    return text if len(text) <= longest else text[: longest - 3] + "..."


def bounded(text: str) -> str:
    """Return a message of at most 480 characters: its longest words are cut in the middle, then it is itself.

    With what a program puts before it, it stays within 500.
    """
    for longest in (240, 120, 60):
        if len(text) > LONGEST_MESSAGE:
            text = " ".join(_middle_cut(word, longest) for word in text.split(" "))
    return _middle_cut(text, LONGEST_MESSAGE)


def _middle_cut(text: str, longest: int) -> str:
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]}…{text[half - longest + 1 :]}"


def plain_number(text: str) -> float:
    """Return a number as `float` does, but only of ASCII digits without underscores. Raises ValueError."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{shortened(text)!r} is not a number")
    return float(text)


def quoted_names(names: Sequence[str]) -> str:
    """Return names from a message as a line quotes them: the first few, each of bounded length."""
    shown = [repr(shortened(name)) for name in names[:4]]
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return f"[{', '.join(shown)}]{more}"


def _at_words(line: str, width: int) -> str:
    """Return a line with spaces up to the edge of a terminal wherever it would break a word.

    A newline would do, too, but make two lines of a command that is copied.
    """
    rows = []
    while len(line) > width:
        cut = line.rfind(" ", 0, width)
        cut = cut if line[width] != " " and line[:cut].strip() else width
        rows.append(line[:cut].ljust(width))
        line = line[cut:] if cut == width else line[cut:].lstrip(" ")
    return "".join([*rows, line])


class PrintableStream:
    """A stream that prints only `printable` text; what an ASCII terminal lacks becomes a question mark.

    On a terminal, a line that is too long for it breaks between words.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")

    # What is printed is text for `stream`; a library must not encode it for an ASCII terminal by itself.
    encoding = "utf-8"

    def write(self, text: str) -> int:
        """Print the text."""
        lines = printable(text).split("\n")
        if self.stream.isatty() and (width := os.get_terminal_size(self.stream.fileno()).columns):
            lines = [_at_words(line, width) for line in lines]
        return self.stream.write("\n".join(lines))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)
