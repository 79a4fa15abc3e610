"""Results, declared once: from a class's fields follow its JSON document and the document's JSON Schema.

Classes are dataclasses and named tuples. In ``Annotated``, a text describes a field (its unit, what null
means), a `Quantity` a number, a `Keyword` adds to its schema, and `As`, `Named`, `OMITTED` and `ALSO`
change what is written.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from html import escape
from inspect import get_annotations
from math import inf, isfinite, isnan
from pathlib import Path
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from .text import printable

OMITTED = object()  # of a field: it is not in the document
ALSO = object()  # of what a property returns: it is in the document, after the fields


class Quantity(NamedTuple):
    """A number's name, unit and meaning, and whether a smaller magnitude is better."""

    label: str
    unit: str
    meaning: str = ""
    ranked: bool = True

    @property
    def terminal_unit(self) -> str:
        """The unit as terminals show it: ``N m``, as parameters and explanations have it."""
        return self.unit.replace("·", " ")

    def said(self, words: Callable[[str], str]) -> Quantity:
        """Return it with label and unit in the words of a plant."""
        return self._replace(label=words(self.label), unit=words(self.unit))


class Keyword(NamedTuple):
    """A further keyword of a schema."""

    name: str
    value: object


class Named(NamedTuple):
    """A member's name in the document, where it is not the attribute's."""

    name: str


class As(NamedTuple):
    """What a member is in the document: its type there, and how it is made; None stays None."""

    kind: Any
    made: Callable[[Any], object]


Count = Annotated[int, Keyword("minimum", 0)]


def known(value: float) -> float | None:
    """Return a number; None where it is not finite."""
    return value if isfinite(value) else None


Known = Annotated[float, As(float | None, known)]

_REAL = {"anyOf": [{"type": "number"}, {"enum": ["NaN", "Infinity", "-Infinity"]}]}
_TYPES = {bool: "boolean", int: "integer", str: "string", Path: "string", type(None): "null"}


class Result:
    """What a verb prints with ``--json``; ``document``: its name and version, such as ``metrics-1``.

    Every subclass is a frozen dataclass.
    """

    document: ClassVar[str]

    def __init_subclass__(cls, document: str = "") -> None:
        if document:
            cls.document = document


def document(result: Result) -> dict[str, object]:
    """Return a result as JSON has it, beginning with the name of its schema."""
    return {"schema": f"trunk/{result.document}", **values(result)}


def values(result: object) -> dict[str, object]:
    """Return the members of a dataclass or a named tuple as JSON has them, by name."""
    shown: dict[str, object] = {}
    kind: Any = type(result)
    for name, hint in members(kind).items():
        value = getattr(result, name)
        for extra in get_args(hint):
            if isinstance(extra, As) and value is not None:
                value = extra.made(value)
        shown[_key(name, hint)] = plain(value)
    return shown


def plain(value: object) -> object:
    """Return a value as JSON has it: paths and the numbers that JSON lacks become strings.

    NaN and the infinities are ``"NaN"``, ``"Infinity"`` and ``"-Infinity"``, as Python's ``float`` and
    JavaScript's ``Number`` read them; None (null) only ever means that there is no value.
    """
    if isinstance(value, float) and not isfinite(value):
        return "NaN" if isnan(value) else "Infinity" if value > 0.0 else "-Infinity"
    kind: Any = type(value)
    if members(kind):
        return values(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def schema(kind: type[Result]) -> dict[str, object]:
    """Return the JSON Schema (draft 2020-12) of a result's document."""
    shared: dict[str, Any] = {}
    _schema(kind, shared)
    own = shared.pop(kind.__name__)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": (kind.__doc__ or "").partition("\n")[0].rstrip(".").replace("``", ""),
        "type": "object",
        "properties": {"schema": {"const": f"trunk/{kind.document}"}, **own["properties"]},
        "required": ["schema", *own["required"]],
        "additionalProperties": False,
        "$defs": shared,
    }


def quantities(kind: type) -> dict[str, Quantity]:
    """Return the descriptions of a class's numbers, by name."""
    described = ((name, get_args(hint)) for name, hint in members(kind).items())
    return {name: of for name, (_, *ofs) in described for of in ofs if isinstance(of, Quantity)}


def number(value: float | None, digits: int = 6) -> str:
    """Return a number as text: "not defined" for None, "never" for infinity."""
    if value is None:
        return "not defined"
    return "never" if value == inf else f"{value:.{digits}g}"


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in HTML, every text escaped: a recording's words are not markup."""

    def line(tag: str, cells: Sequence[object]) -> str:
        aligned = ("left", *("right" for _ in cells[1:])) if len(cells) > 2 else ("left", "left")
        return "".join(
            f'<{tag} style="text-align: {side}">{escape(printable(str(cell)))}</{tag}>'
            for cell, side in zip(cells, aligned, strict=False)
        )

    head = f"<thead><tr>{line('th', header)}</tr></thead>" if any(header) else ""
    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    caption = f'<caption style="text-align: left"><b>{escape(printable(title))}</b></caption>'
    return f"<table>{caption}{head}<tbody>{body}</tbody></table>"


def text_table(rows: Iterable[Sequence[str]]) -> str:
    """Return rows as text in columns: the first left, the second right, the rest left."""
    cells = [[printable(cell) for cell in row] for row in rows]
    first, second = (max((len(row[i]) for row in cells), default=0) for i in (0, 1))
    return "\n".join(
        f"{row[0]:{first}}  {row[1]:>{second}}  {' '.join(row[2:])}".rstrip() for row in cells
    )


@cache
def members(kind: Any) -> dict[str, Any]:
    """Return the members that a class has in the document, with their types; none of another class."""
    if is_dataclass(kind):
        names = [field.name for field in fields(kind)]
    elif issubclass(kind, tuple) and hasattr(kind, "_fields"):
        names = list(kind._fields)
    else:
        return {}
    hints = get_type_hints(kind, include_extras=True)
    held = {name: hints[name] for name in names if OMITTED not in get_args(hints[name])}
    for name, value in vars(kind).items():
        if isinstance(value, property):
            returned = get_annotations(value.fget, eval_str=True).get("return")  # type: ignore[arg-type]
            if ALSO in get_args(returned):
                held[name] = returned
    return held


def _key(name: str, hint: Any) -> str:
    return next((extra.name for extra in get_args(hint) if isinstance(extra, Named)), name)


def _schema(hint: Any, shared: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a type; those of classes are put into ``shared``."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        other = [extra.kind for extra in inner if isinstance(extra, As)]
        made = dict(_schema((other or inner)[0], shared))
        for extra in inner[1:]:
            if isinstance(extra, Quantity):
                made["description"] = f"{extra.label}, {extra.unit}: {extra.meaning}"
            elif isinstance(extra, str):
                made["description"] = extra
            elif isinstance(extra, Keyword):
                made[extra.name] = plain(extra.value)
        return made
    if origin in (Union, types.UnionType):
        return {"anyOf": [_schema(kind, shared) for kind in inner]}
    if origin is Literal:
        return {"enum": list(inner)}
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _schema(inner[1], shared)}
    if origin is tuple and inner[-1] is not Ellipsis:
        count = {"minItems": len(inner), "maxItems": len(inner)}
        return {"type": "array", "items": _schema(inner[0], shared), **count}
    if origin is not None and issubclass(origin, Sequence):
        return {"type": "array", "items": _schema(inner[0], shared)}
    if hint is float:
        return _REAL
    if hint in _TYPES:
        return {"type": _TYPES[hint]}
    held = members(hint) if isinstance(hint, type) else {}
    if not held:
        return {}  # anything
    if hint.__name__ not in shared:
        shared[hint.__name__] = {}  # while its members are looked at
        properties = {_key(name, kind): _schema(kind, shared) for name, kind in held.items()}
        shared[hint.__name__] = {
            "type": "object",
            "properties": properties,
            "required": [*properties],
            "additionalProperties": False,
        }
    return {"$ref": f"#/$defs/{hint.__name__}"}
