"""What every page should know, piece by piece; slow readers skip older versions. Pure."""

from __future__ import annotations

from .protocol import words


class Board:
    """Pieces of text by kind and name. A reader keeps the version of the last piece that it has read."""

    def __init__(self) -> None:
        self._version = 0
        self._pieces: dict[tuple[str, str], tuple[int, str]] = {}

    def put(self, kind: str, name: str = "", **values: object) -> None:
        """Replace a piece's last version; nothing changes if both are equal."""
        text = words(kind, **({"name": name} if name else {}), **values)
        if self._pieces.get((kind, name), (0, ""))[1] != text:
            self._version += 1
            self._pieces.pop(
                (kind, name), None
            )  # so that the pieces stay in the order of their versions
            self._pieces[kind, name] = self._version, text

    def after(self, version: int) -> tuple[int, str] | None:
        """Return the oldest piece newer than a version, and its own version; None if there is none."""
        if version >= self._version:
            return None
        return next(piece for piece in self._pieces.values() if piece[0] > version)

    def texts(self) -> list[str]:
        """Return the last version of all pieces."""
        return [text for _, text in self._pieces.values()]
