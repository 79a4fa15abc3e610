"""What became of edits, as it is kept and compared."""

from __future__ import annotations

import json
import lzma
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

WORDS = {
    "p": "passes",
    "d": "diverges",
    "c": "inconclusive",
    "r": "verify raises",
}
PASSES, RAISES = "p", "r"
NUMBER, OTHER = "n", "o"


class Caught(NamedTuple):
    """What became of an edit."""

    mark: str  # NUMBER if it changes a number of the loop, else OTHER
    letter: str  # of what `trunk verify` says
    reason: str = ""  # why it may pass

    @property
    def passes(self) -> bool:
        return self.letter == PASSES


def packed(edits: Mapping[str, Caught]) -> bytes:
    """Return what became of each edit, by base and kind, compressed."""
    kinds: dict[str, dict[str, dict[str, list[str]]]] = {}
    for full_name, caught in edits.items():
        base, kind, name = full_name.split(": ", 2)
        reason = [caught.reason] if caught.reason else []
        kinds.setdefault(base, {}).setdefault(kind, {})[name] = [
            caught.mark + caught.letter,
            *reason,
        ]
    text = json.dumps(kinds, indent=0, ensure_ascii=False)
    return lzma.compress(text.encode(), preset=9)


def unpacked(data: bytes) -> dict[str, Caught]:
    """Return what became of each edit, by its name."""
    kinds = json.loads(lzma.decompress(data))
    return {
        f"{base}: {kind}: {name}": Caught(*letters, *reason)
        for base, names_of in kinds.items()
        for kind, names in names_of.items()
        for name, (letters, *reason) in names.items()
    }


class Comparison(NamedTuple):
    """Edits of which something else is said than before, by their names."""

    slipped: list[str]  # they change a number, were caught, and pass now
    raising: list[str]
    others_slipped: list[str]  # they change no number, were caught, and pass now
    newly_caught: list[str]
    other_words: Counter[str]  # caught before and now: how many by both words
    new: list[str]
    new_passing: list[str]  # those of them that change a number and pass
    gone: list[str]

    @property
    def wrong(self) -> bool:
        """True if an edit of a number slips through, or `trunk verify` raises."""
        return bool(self.slipped or self.raising)

    def lines(self) -> Iterator[str]:
        """Yield what has changed: a line for each edit that matters, counts of the others."""
        for name in self.slipped:
            yield f"{name}: a number changed: it was caught, and passes now"
        for name in self.raising:
            yield f"{name}: verify raises"
        for name in self.new_passing:
            yield f"{name}: a number changed: it passes, and was not frozen"
        yield f"{len(self.slipped)} edits that change a number pass now and did not"
        yield f"{len(self.others_slipped)} others pass now and did not{_by_kind(self.others_slipped)}"
        yield f"{len(self.newly_caught)} caught now that passed{_by_kind(self.newly_caught)}"
        for words, count in sorted(self.other_words.items()):
            yield f"{count} caught as before by another word: {words}"
        yield f"{len(self.new)} not frozen, {len(self.gone)} gone"


def _by_kind(names: list[str]) -> str:
    kinds = Counter(name.split(": ", 2)[1] for name in names)
    return "".join(f"; {kind}: {count}" for kind, count in sorted(kinds.items()))


def compared(before: Mapping[str, Caught], now: Mapping[str, Caught]) -> Comparison:
    """Compare what became of edits with what became of them before."""
    both = {name: (before[name], now[name]) for name in now if name in before}
    slipped = [name for name, (old, new) in both.items() if new.passes and not old.passes]
    new = [name for name in now if name not in before]
    return Comparison(
        slipped=[name for name in slipped if now[name].mark == NUMBER],
        raising=[name for name, caught in now.items() if caught.letter == RAISES],
        others_slipped=[name for name in slipped if now[name].mark != NUMBER],
        newly_caught=[name for name, (old, new) in both.items() if old.passes and not new.passes],
        other_words=Counter(
            f"{WORDS[old.letter]}, now {WORDS[new.letter]}"
            for old, new in both.values()
            if old.letter != new.letter and not (old.passes or new.passes)
        ),
        new=new,
        new_passing=[name for name in new if now[name].passes and now[name].mark == NUMBER],
        gone=[name for name in before if name not in now],
    )
