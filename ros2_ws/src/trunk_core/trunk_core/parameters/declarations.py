"""Parameters declared once: type, default, unit, bounds and description, as fields of a frozen dataclass.

A configuration is a frozen dataclass whose fields are made by `parameter`. The same class is filled
from the parameters of a ROS node, from a parameter file offline and from a recording, always through
`build`, so that a value is checked in one place and an error reads the same everywhere.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from functools import partial
from typing import Any, NamedTuple, TypeVar

from ..errors import TrunkError
from ..samples import Value as Value
from ..text import plain_number, shortened

Config = TypeVar("Config")

# rclpy declares these in every node; `ros2 param dump` writes them with a node's own.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")


class ParameterError(TrunkError, ValueError):
    """A parameter's name, its value and what is allowed, in one line."""

    def __init__(self, name: str, value: object, allowed: str) -> None:
        self.name = name
        self.value = value
        self.allowed = allowed
        super().__init__(f"parameter {_shown(name)}: {_shown(value)} is not allowed: {allowed}")


def _shown(value: object) -> str:
    return shortened(repr(list(value) if isinstance(value, tuple | array) else value), 80)


@dataclass(frozen=True)
class Declaration:
    """One parameter's declaration. ``kind`` is the type's name as ROS 2 prints it.

    ``unit`` is written as in ``N m/(rad s)``, and for an array of fixed length as one for each element,
    ``m, rad``, or one for all.
    """

    name: str
    default: Value
    kind: str
    unit: str
    description: str
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None  # exclusive lower bound
    at_least: str = ""  # another parameter that this one must not be below (`check_together`)
    unbounded: bool = False  # infinities are allowed
    choices: tuple[str, ...] = ()
    length: int | None = None
    shortest: int = 0  # of an array without a fixed length
    longest: int | None = None  # likewise
    each: str = ""  # what one element of an array is
    table: bool = False  # rows of cells, each of which a name of its own may set (`with_cells`)
    fixed: bool = False  # cannot change after start
    unit_by: str = ""  # the parameter whose value chooses the unit among ``units``
    units: tuple[tuple[str, str], ...] = ()  # that value, and the unit

    def allowed(self) -> str:
        """Return the allowed values as a readable phrase."""
        each = "each " if self.kind.endswith("array") else ""
        phrase = self.kind
        if self.length is not None:
            phrase += f" of {self.length}"
        elif self.longest is not None:
            least = f"{self.shortest} to" if self.shortest else "at most"
            phrase += f" of {least} {self.longest}"
        phrase += f", {self.each}" if self.each else ""
        if self.choices:
            return f"{phrase}, {each}one of {', '.join(self.choices)}"
        bounds = self.bounds()
        return f"{phrase}{', ' + each if bounds else ''}{bounds}"

    def bounds(self) -> str:
        """Return the bounds as a phrase, empty if there are none."""
        parts = []
        if self.above is not None:
            parts.append(f"> {self.above:g}")
        if self.minimum is not None:
            parts.append(f">= {self.minimum:g}")
        if self.maximum is not None:
            parts.append(f"<= {self.maximum:g}")
        return " and ".join(parts)


_KINDS: dict[type, str] = {bool: "bool", int: "integer", float: "double", str: "string"}


def parameter(
    name: str,
    default: Value,
    description: str,
    *,
    unit: str = "",
    element: type | None = None,
    **limits: Any,
) -> Any:
    """Return a dataclass field that declares the parameter ``name``.

    The type is that of ``default``; ``element`` gives the type of an empty array's elements.
    ``limits`` are the optional fields of `Declaration`.
    """
    if isinstance(default, tuple):
        kind = _KINDS[element or type(default[0])] + " array"
    else:
        kind = _KINDS[type(default)]
    declaration = Declaration(name, default, kind, unit, description, **limits)
    return field(default=default, metadata={"declaration": declaration})


MOST_ROWS = 10_000


def times_parameter(name: str, description: str) -> Any:
    """Return the declaration of times in s, by default none."""
    limits = {"longest": MOST_ROWS, "minimum": 0.0, "maximum": 1e6}
    return parameter(name, (), description, unit="s", element=float, **limits)


def check_rows(prefix: str, times: Sequence[float], values: Sequence[float]) -> None:
    """Raise ParameterError unless ``PREFIX.values`` are as many as ``PREFIX.times``, which ascend."""
    if len(values) != len(times):
        allowed = f"as many as {prefix}.times ({len(times)})"
        raise ParameterError(f"{prefix}.values", values, allowed)
    if list(times) != sorted(times):
        raise ParameterError(f"{prefix}.times", times, "ascending times")


class TableFile(NamedTuple):
    """A CSV file, named by PREFIX.file, that gives PREFIX.times and PREFIX.values.

    Plans read it. Nodes and recordings get the numbers, never a path. ``column``: the heading of the
    values. ``profiles``: the values of PREFIX.profile with which the numbers count; empty: always.
    """

    prefix: str
    column: str
    profiles: tuple[str, ...] = ()

    @property
    def key(self) -> Declaration:
        """The key that names the file, which only plans read."""
        columns = f"CSV with the columns t and {self.column}"
        given = f"for {self.prefix}.times and {self.prefix}.values; a plan holds the numbers"
        return Declaration(f"{self.prefix}.file", "", "string", "", f"{columns}, {given}")


ONLY_PLANNED = "only trunk reads files: give the node the parameter file that trunk plan writes"


def tables_of(config: type[Any]) -> tuple[TableFile, ...]:
    """Return the CSV files that can be named for nodes of a configuration class."""
    tables: tuple[TableFile, ...] = getattr(config, "table_files", ())
    return tables


def only_planned(config: type[Any], name: str) -> bool:
    """Return True for a key that plans read and nodes do not have."""
    return any(name == table.key.name for table in tables_of(config))


def listed(config: type[Any]) -> dict[str, Declaration]:
    """Return all keys of a parameter file: the node's declarations, and what only plans read."""
    keys = {f"{table.prefix}.values": table.key for table in tables_of(config)}
    declared: dict[str, Declaration] = {}
    for name, declaration in declarations(config).items():
        declared |= {name: declaration}
        declared |= {keys[name].name: keys[name]} if name in keys else {}
    return declared


def declarations(config: type[Any]) -> dict[str, Declaration]:
    """Return the declarations of a configuration class by parameter name, in order."""
    return {name: declaration for name, (_, declaration) in _fields(config).items()}


_FIELDS: dict[type[Any], dict[str, tuple[str, Declaration]]] = {}


def _fields(config: type[Any]) -> dict[str, tuple[str, Declaration]]:
    """Return the fields' names and declarations by parameter name, in order."""
    if config not in _FIELDS:
        _FIELDS[config] = {
            f.metadata["declaration"].name: (f.name, f.metadata["declaration"])
            for f in fields(config)
            if "declaration" in f.metadata
        }
    return _FIELDS[config]


def _scalar(declaration: Declaration, value: object, whole: object) -> Any:
    for end in getattr(value, "ends", ()):  # many runs' numbers, all of them between these
        _scalar(declaration, end, whole)
    if hasattr(value, "ends"):
        return value
    kind = declaration.kind.removesuffix(" array")
    if kind == "double" and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)  # a YAML "4" means 4.0
        except OverflowError:
            raise ParameterError(declaration.name, whole, declaration.allowed()) from None
    if type(value) is not {v: k for k, v in _KINDS.items()}[kind]:
        raise ParameterError(
            declaration.name, whole, declaration.allowed() + _plain(declaration, value)
        )
    if isinstance(value, str):
        if declaration.choices and value not in declaration.choices:
            raise ParameterError(declaration.name, whole, declaration.allowed())
        return value
    number: Any = value
    if math.isnan(number) or (math.isinf(number) and not declaration.unbounded):
        raise ParameterError(declaration.name, whole, f"finite {declaration.allowed()}")
    low, high, above = declaration.minimum, declaration.maximum, declaration.above
    if (
        (low is not None and number < low)
        or (high is not None and number > high)
        or (above is not None and number <= above)
    ):
        raise ParameterError(declaration.name, whole, declaration.allowed())
    return number


def _plain(declaration: Declaration, value: object) -> str:
    """Return why ROS 2 takes a value for another type: it has no units, and no texts such as N."""
    if declaration.kind.startswith("string") and isinstance(value, bool | int | float):
        return "; a text that reads as a number, or as y, yes, on, true, n, no, off, false, needs quotes"
    if not declaration.kind.startswith("double") or not looks_like_quantity(value):
        return ""
    return f"; only trunk reads units: give a plain number{' in ' * bool(declaration.unit)}{declaration.unit}"


def check(declaration: Declaration, value: object) -> Value:
    """Return the value as the declared type; an integer is accepted as a double, a list as an array.

    Raises ParameterError for another type, a value out of bounds, NaN, or a wrong length.
    """
    if declaration.kind.endswith("array"):
        if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
            raise ParameterError(declaration.name, value, declaration.allowed())
        items = tuple(value)
        if (
            (declaration.length is not None and len(items) != declaration.length)
            or (declaration.longest is not None and len(items) > declaration.longest)
            or len(items) < declaration.shortest
        ):
            raise ParameterError(declaration.name, items, declaration.allowed())
        return tuple(_scalar(declaration, item, items) for item in items)
    checked: Value = _scalar(declaration, value, value)
    return checked


def check_together(config: Any) -> None:
    """Check the declared rules that join parameters of a configuration. Raises ParameterError."""
    values: dict[str, Any] = values_of(config)
    for name, declared in declarations(type(config)).items():
        if declared.at_least and values[name] < values[declared.at_least]:
            least = f"at least {declared.at_least} ({values[declared.at_least]:g})"
            raise ParameterError(name, values[name], least)


def of_every_node(name: str) -> bool:
    """Return True for a parameter that every ROS node has, whatever it declares itself."""
    return name in _OF_EVERY_NODE or is_qos_override(name)


def is_qos_override(name: str) -> bool:
    """Return True for a parameter that sets the quality of service of a topic: ``qos_overrides.TOPIC.…``."""
    return name.startswith("qos_overrides.")


def unknown_name(name: str, known: Iterable[str]) -> str:
    """Return the message for a name that nothing declares."""
    known = list(known)
    if name.startswith("rules.") and name.rpartition(".")[0] in known:
        return f"no such parameter; a cell of a table has a column too: {name}.COLUMN"
    gain = re.fullmatch(r"(?:gains\.)?k([pid])", name, re.IGNORECASE)
    close = [meant for meant in known if gain and meant.startswith(f"gains.{gain[1].lower()}")][:2]
    close = close or _with_word(name, known) or get_close_matches(name, known, n=1)
    advice = (
        f"did you mean {' or '.join(map(repr, close))}?" if close else "trunk params lists them all"
    )
    return f"no such parameter; {advice}"


def _with_word(name: str, known: Sequence[str]) -> list[str]:
    """Return the first names of the same table that have the last part of a name as one of their words."""
    table, dot, word = name.rpartition(".")
    parts = {full: re.split(r"[._]", full.removeprefix(table + dot)) for full in known}
    return [full for full, words in parts.items() if full.startswith(table) and word in words][:4]


def build(config: type[Config], values: Mapping[str, object]) -> Config:
    """Return the configuration with ``values`` (by parameter name) over the defaults.

    A value may be that of a table's cell (`with_cells`). Raises ParameterError for an unknown name, a bad
    value, or values that do not fit together (checked by the class's ``__post_init__``).
    """
    return config(**checked(config, values))


def changed(config: Config, values: Mapping[str, object]) -> Config:
    """Return the configuration with other values of some parameters. Raises as `build` does."""
    new: Config = replace(config, **checked(type(config), values, partial(values_of, config)))  # type: ignore[type-var]
    return new


def checked(
    config: type[Any],
    values: Mapping[str, object],
    present: Callable[[], Mapping[str, Value]] = dict,
) -> dict[str, Any]:
    """Return values, each checked on its own, by the names of the configuration's fields.

    ``present`` gives the values to which those of a table's cell or an array's element are changes.
    """
    values = with_cells(config, values, present)
    declared = _fields(config)
    for name, value in values.items():
        if name not in declared:
            raise ParameterError(name, value, unknown_name(name, declared))
    return {
        field_name: check(declaration, values[name])
        for name, (field_name, declaration) in declared.items()
        if name in values
    }


def table_of(name: str, declared: Container[str]) -> str:
    """Return the declared parameter of which ``name`` may be a part; empty: of none.

    A part is a cell, TABLE.ROW.COLUMN, or an element, ARRAY[INDEX].
    """
    table = name.rsplit(".", 2)[0] if name.count(".") > 2 else ""
    if name.endswith("]"):
        table = name.partition("[")[0]
    return table if name not in declared and table in declared else ""


def index_in(name: str, value: object, array: Sequence[object]) -> int:
    """Return the index in ARRAY[INDEX], an element's name. Raises ParameterError if it is not there."""
    whole, _, text = name.removesuffix("]").partition("[")
    if not (text.isascii() and text.isdecimal()) or int(text) >= len(array):
        raise ParameterError(name, value, f"{whole} has the elements [0] to [{len(array) - 1}]")
    return int(text)


def with_cells(
    config: type[Any],
    values: Mapping[str, object],
    present: Callable[[], Mapping[str, Value]] = dict,
) -> Mapping[str, object]:
    """Return values in which each part of a parameter is changed in the parameter itself.

    A part is a cell of a table, ``rules.kd.ZO.PS``, or an element of an array, ``initial.position[1]``.

    ``config``: its ``table_labels`` gives the labels of a table's rows and columns from the values of all
    parameters. ``present`` gives the values to which ``values`` are changes, else the defaults. Raises
    ParameterError, which lists the labels, for a cell that is not there, and for a value that is no cell.
    """
    declared = declarations(config)
    cells = {
        name: table
        for name in values
        if (table := table_of(name, declared))
        and (declared[table].table or (name.endswith("]") and "array" in declared[table].kind))
    }
    if not cells:
        return values
    whole = {name: value for name, value in values.items() if name not in cells}
    usual = present() or {name: declaration.default for name, declaration in declared.items()}
    complete = {**usual, **whole}
    for name, table in cells.items():
        whole_value: Any = check(declared[table], whole.get(table, complete[table]))
        if name.endswith("]"):
            elements = list(whole_value)
            elements[index_in(name, values[name], elements)] = values[name]
            whole[table] = tuple(elements)
            continue
        labels: tuple[Sequence[str], Sequence[str]] = config.table_labels(complete)
        places = []
        for label, known, axis in zip(name.split(".")[-2:], labels, ("row", "column"), strict=True):
            if label not in known:
                raise ParameterError(
                    name, values[name], f"{label} is no {axis} of {table}: {', '.join(known)}"
                )
            places.append(known.index(label))
        value = values[name]
        text = value if isinstance(value, str) else repr(value)
        if (
            isinstance(value, bool)
            or not isinstance(value, str | int | float)
            or len(text.split()) != 1
        ):
            raise ParameterError(name, value, "a label, or a number")
        rows = list(whole_value)
        row = rows[places[0]].split() if places[0] < len(rows) else []
        if places[1] < len(row):  # a table of another size is refused as a whole
            row[places[1]] = text
            rows[places[0]] = " ".join(row)
        whole[table] = tuple(rows)
    return whole


def values_of(config: Any) -> dict[str, Value]:
    """Return a configuration's values by parameter name, as `build` takes them."""
    return {
        name: getattr(config, field_name) for name, (field_name, _) in _fields(type(config)).items()
    }


def value_of(config: Any, name: str) -> Any:
    """Return the value of one parameter, or of an array's element, ARRAY[INDEX]."""
    whole, _, index = name.removesuffix("]").partition("[")
    value = getattr(config, _fields(type(config))[whole][0])
    return value[int(index)] if index else value


# Sign, infinity or digits, the digits' exponent, unit.
QUANTITY = re.compile(
    r"\s*([-+]?)(?:\.?(inf)(?=\s)|((?:\d+\.?\d*|\.\d+)(?:[eE]([-+]?\d+))?)(?![\d.]))\s*(\S.*)",
    re.ASCII | re.DOTALL,
)


class UnitError(TrunkError):
    """A number with a unit that cannot be used: what is wrong, and what is allowed."""


def looks_like_quantity(value: object) -> bool:
    """Return True for a text that begins with a number and is not one by itself."""
    if not isinstance(value, str) or not QUANTITY.match(value):
        return False
    try:
        plain_number(value)
    except ValueError:
        return True
    return False
