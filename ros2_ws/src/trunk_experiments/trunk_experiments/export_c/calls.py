"""What expressions call, and elements of tables and arrays: named tuples, functions, built-in functions."""

from __future__ import annotations

import ast
import inspect
from collections import Counter
from collections.abc import Callable
from types import FunctionType
from typing import Any

from .built_in import BuiltIns
from .layout import CodeBlock, Line, words_in
from .program import Definitions, Translated
from .types import (
    INTEGERS,
    NATURAL,
    REAL,
    Array,
    RecordType,
    Static,
    TableType,
    Type,
    UntranslatableError,
    Value,
    at_run_time,
    joined,
    shown,
)


class Calls(BuiltIns):
    """What `function.Translator` knows of calls and elements."""

    program: Definitions
    python: Any
    variables: dict[str, Any]
    stores: Counter[str]
    declared: dict[str, str]
    fresh: set[str]
    block: CodeBlock
    writes: bool
    returning: bool
    result: Type | None
    outputs: list[tuple[str, Type]]
    begin_result: Callable[[Type], None]
    refused: Callable[[ast.AST, str, str], UntranslatableError]
    expression: Callable[[ast.expr], Value]
    fields: Callable[[Value], list[Value]]
    emit: Callable[..., None]
    temporary: Callable[[Type, str], str]
    in_memory: Callable[[Value, str], Value]
    converted: Callable[[Value, Type, ast.AST], Value]
    made: Callable[..., Value]
    bare: Callable[[str], str]
    mentions: Callable[[Value, str], bool]

    # Elements ------------------------------------------------------------------------------------------

    def element(self, value: Value, node: ast.Subscript) -> Value:
        """Return an element of a tuple, a table or an array."""
        t = value.type
        if isinstance(t, Array):
            return self._of_array(value, t, node)
        index = self.expression(node.slice)
        if index.type not in INTEGERS:
            raise self.refused(node, f"an index of {shown(index.type)}", "use an int")
        length = t.length if isinstance(t, TableType) else len(t.types)  # type: ignore[union-attr]
        if isinstance(t, TableType) and length == 0:  # never reached: Python would raise
            return Value(t.element, self.program.literal(0.0 if t.element == REAL else 0))
        if index.is_known:
            if not -length <= index.known < length:
                raise self.refused(node, f"it has {length} elements", "use an index within them")
            return self.fields(value)[int(index.known)]
        if isinstance(t, RecordType) and not t.row:
            raise self.refused(
                node, "an index that is not known, of different types", "use a literal index"
            )
        code = self.bare(index.code)
        if index.type != NATURAL:
            code = f"index_in({code}, {length})"
        if isinstance(t, TableType):
            return Value(t.element, f"{value.code}[{code}]", place=True)
        memory = self.in_memory(value, "row")
        assert isinstance(t, RecordType)
        owner = memory.code
        place = f"{owner[2:-1]}->v" if owner.startswith("(*") else f"{owner}.v"
        return Value(t.types[0], f"{place}[{code}]", place=True)

    def _of_array(self, value: Value, t: Array, node: ast.Subscript) -> Value:
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(indices) != t.dimensions:
            raise self.refused(
                node, f"an array of {t.dimensions} dimensions", "give an index for each"
            )
        codes = []
        for i, single in zip(
            indices, ("rows", "columns") if t.dimensions == 2 else ("length",), strict=True
        ):
            index = self.expression(i)
            if index.type not in INTEGERS:
                raise self.refused(node, f"an index of {shown(index.type)}", "use an int")
            code = self.bare(index.code)
            if index.type != NATURAL:
                code = f"index_in({code}, {value.code}.{single})"
            codes.append(code)
        if t.dimensions == 2:
            place = f"{value.code}.data[({codes[0]}) * {value.code}.columns + {codes[1]}]"
        else:
            place = f"{value.code}.data[{codes[0]}]"
        return Value(t.element, place, place=True)

    # Calls ---------------------------------------------------------------------------------------------

    def _x_call(self, node: ast.Call) -> Value:
        return self.call(node)

    def call(self, node: ast.Call, alone: bool = False, target: ast.expr | None = None) -> Value:
        """Return the value of a call; ``alone``: it is all of a statement, or of its right side."""
        returned, self.returning = self.returning, False
        if any(isinstance(a, ast.Starred) for a in node.args) or any(
            k.arg is None for k in node.keywords
        ):
            raise self.refused(node, "a star in a call", "name each argument")
        if isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
            return self._replaced(node, node.func.value)
        function = self.expression(node.func)
        if not isinstance(function.type, Static):
            raise self.refused(node, f"a call of {shown(function.type)}", "call a function")
        callee = function.type.value
        arguments = [self.expression(a) for a in node.args]
        named = {str(k.arg): self.expression(k.value) for k in node.keywords}
        if isinstance(callee, type) and issubclass(callee, tuple) and hasattr(callee, "_fields"):
            return self._record(node, callee, arguments, named)
        if isinstance(callee, FunctionType):
            self.returning = returned
            return self._function(node, callee, arguments, named, alone, target)
        if named:
            raise self.refused(
                node, "named arguments of a built-in function", "leave out the names"
            )
        return self._built_in(node, callee, arguments)

    def _replaced(self, node: ast.Call, owner: ast.expr) -> Value:
        value = self.expression(owner)
        t = value.type
        if not isinstance(t, RecordType) or t.kind is None or node.args:
            raise self.refused(node, "_replace of what is no named tuple", "make a new tuple")
        parts = dict(zip(t.names, self.fields(value), strict=True))
        for keyword in node.keywords:
            if keyword.arg not in parts:
                raise self.refused(node, f"there is no field {keyword.arg}", "see the named tuple")
            before, new = parts[keyword.arg].type, self.expression(keyword.value)
            if joined(before, new.type) is None:
                problem = f"{keyword.arg} was {shown(before)}, and becomes {shown(new.type)}"
                raise self.refused(node, problem, "keep its type: 0.0 for 0")
            parts[keyword.arg] = new
        return self.made(t.kind, list(parts.values()))

    def _record(
        self, node: ast.Call, kind: type[Any], given: list[Value], named: dict[str, Value]
    ) -> Value:
        fields: tuple[str, ...] = kind._fields
        defaults: dict[str, Any] = getattr(kind, "_field_defaults", {})
        values = list(given)
        for name in fields[len(given) :]:
            if name in named:
                values.append(named.pop(name))
            elif name in defaults:
                values.append(self.program.value(defaults[name]))
        if named or len(values) != len(fields):
            raise self.refused(
                node,
                f"{kind.__name__} has the fields {', '.join(fields)}",
                "give each of them once",
            )
        return self.made(kind, values)

    def _function(
        self,
        node: ast.Call,
        callee: FunctionType,
        given: list[Value],
        named: dict[str, Value],
        alone: bool,
        target: ast.expr | None,
    ) -> Value:
        values = list(given)
        for parameter in list(inspect.signature(callee).parameters.values())[len(given) :]:
            if parameter.name in named:
                values.append(named.pop(parameter.name))
            elif parameter.default is not inspect.Parameter.empty:
                values.append(self.program.value(parameter.default))
            else:
                raise self.refused(
                    node, f"{parameter.name} is not given", "give each argument once"
                )
        if named or len(values) != len(inspect.signature(callee).parameters):
            raise self.refused(node, "it is given what it does not take", "give each argument once")
        f = self.program.function(callee, [value.type for value in values])
        codes = [self._argument(value) for value in values if at_run_time(value.type)]
        if f.writes:
            self.writes = True
            if not alone:
                raise self.refused(
                    node, "it writes into an array", "assign its result on a line of its own"
                )
        if not f.outputs:
            code = f"{f.name}({', '.join(codes)})"
            if f.writes and at_run_time(f.result):
                c = self.temporary(f.result, callee.__name__.strip("_"))
                self.emit(f"{c} = {code};", c)
                return Value(f.result, c, place=True)
            return Value(f.result, code)
        return self._with_outputs(f, codes, values, target)

    def _argument(self, value: Value) -> str:
        if not isinstance(value.type, RecordType):
            return self.bare(value.code)
        code = self.in_memory(value, _hint(value.type)).code
        return code[2:-1] if code.startswith("(*") else f"&{code}"

    def _with_outputs(
        self, f: Translated, codes: list[str], values: list[Value], target: ast.expr | None
    ) -> Value:
        """Call a function that writes through pointers: into the target, where that is no argument."""
        returned, self.returning = self.returning, False
        if returned and self.result is None:
            self.begin_result(f.result)
        if returned and [t for _, t in f.outputs] == [t for _, t in self.outputs]:
            outputs = [c for c, _ in self.outputs]
            self.block.body.append(Line(f"{f.name}({', '.join([*codes, *outputs])});"))
            return self._written(f, [f"(*{c})" for c in outputs])
        plain = isinstance(f.result, RecordType) and f.result.kind is None
        live = [i for i, t in enumerate(f.result.types) if at_run_time(t)] if plain else [0]  # type: ignore[union-attr]
        targets: list[ast.expr | None] = [None] * len(f.outputs)
        if plain and isinstance(target, ast.Tuple):
            if len(target.elts) == len(f.result.types):  # type: ignore[union-attr]
                targets = [target.elts[i] for i in live]
        elif not plain:
            targets = [target]
        names = [t.id for t in targets if isinstance(t, ast.Name)]
        used = {v.value.code for v in self.variables.values()}
        places = []
        for (c, t), single in zip(f.outputs, targets, strict=True):
            variable = self.variables.get(single.id) if isinstance(single, ast.Name) else None
            place = variable.value.code if variable is not None else ""
            usable = (
                variable is not None
                and variable.type == t
                and place in self.declared
                and names.count(getattr(single, "id", "")) == 1
                and not any(place in words_in(code) for code in behind(f, codes, c, place))
            )
            hint = (
                single.id.strip("_") if isinstance(single, ast.Name) and single.id.strip("_") else c
            )
            places.append(
                place
                if usable
                else self.temporary(t, hint if hint != c else f.python.__name__.strip("_"))
            )
        self.fresh |= {c for c in places if c not in used}
        whole = [*codes, *(f"&{place}" for place in places)]
        self.block.body.append(Line(f"{f.name}({', '.join(whole)});", places[0]))
        return self._written(f, places)

    def _written(self, f: Translated, places: list[str]) -> Value:
        """Return a result that was written to these places."""
        parts = [Value(t, c, place=True) for c, (_, t) in zip(places, f.outputs, strict=True)]
        assert isinstance(f.result, RecordType)
        if f.result.kind is not None:
            return parts[0]
        rest = iter(parts)
        return self.made(None, [next(rest) if at_run_time(t) else Value(t) for t in f.result.types])


def behind(f: Translated, codes: list[str], output: str, place: str) -> list[str]:
    """Return the arguments that must not read a place if this output is written to it."""
    own = f.in_place and output == f.outputs[0][0] and codes[0] == f"&{place}"
    return codes[1:] if own else codes


def _hint(t: RecordType) -> str:
    """Return a name for a variable of a record's type."""
    kind = t.kind.__name__ if t.kind is not None else "Tuple"
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in kind).strip("_")
