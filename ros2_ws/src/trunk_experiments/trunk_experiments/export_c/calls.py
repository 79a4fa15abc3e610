"""What expressions call, and elements of tables and arrays: named tuples, functions, built-in functions."""

from __future__ import annotations

import ast
import inspect
from types import FunctionType
from typing import Any

from .built_in import BuiltIns
from .layout import Line, words_in
from .program import Translated
from .types import (
    INTEGERS,
    NATURAL,
    REAL,
    Array,
    RecordType,
    Static,
    TableType,
    Value,
    at_run_time,
    joined,
    shown,
)


class Calls(BuiltIns):
    """What `function.Translator` knows of calls and elements."""

    # Elements ------------------------------------------------------------------------------------------

    def element(self, value: Value, place: ast.expr) -> Value:
        """Return an element of a tuple, a table or an array."""
        t = value.type
        if isinstance(t, Array):
            return self._of_array(value, t, place)
        index = self.expression(place)
        length = t.length if isinstance(t, TableType) else len(t.types)  # type: ignore[union-attr]
        if isinstance(t, TableType) and length == 0:  # never reached: Python would raise
            return Value(t.element, self.program.literal(0.0 if t.element == REAL else 0))
        if index.is_known:
            if not -length <= index.known < length:
                raise self.refused(f"it has {length} elements", "use an index within them")
            return self.fields(value)[int(index.known)]
        if isinstance(t, RecordType) and not t.row:
            raise self.refused("an index not known, of different types", "use a literal index")
        code = self._index(index, length)
        if isinstance(t, TableType):
            return Value(t.element, f"{value.code}[{code}]", place=True)
        memory = self.in_memory(value, "row")
        assert isinstance(t, RecordType)
        owner = memory.code
        row = f"{owner[2:-1]}->v" if owner.startswith("(*") else f"{owner}.v"
        return Value(t.types[0], f"{row}[{code}]", place=True)

    def _index(self, index: Value, length: int | str) -> str:
        """Return the code of an index, counted from the beginning."""
        if index.type not in INTEGERS:
            raise self.refused(f"an index of {shown(index.type)}", "use an int")
        code = self.bare(index.code)
        return code if index.type == NATURAL else f"index_in({code}, {length})"

    def _of_array(self, value: Value, t: Array, place: ast.expr) -> Value:
        indices = place.elts if isinstance(place, ast.Tuple) else [place]
        if len(indices) != t.dimensions:
            raise self.refused(f"an array of {t.dimensions} dimensions", "give an index for each")
        lengths = ("rows", "columns") if t.dimensions == 2 else ("length",)
        codes = [
            self._index(self.expression(index), f"{value.code}.{length}")
            for index, length in zip(indices, lengths, strict=True)
        ]
        code = f"({codes[0]}) * {value.code}.columns + {codes[1]}" if codes[1:] else codes[0]
        return Value(t.element, f"{value.code}.data[{code}]", place=True)

    # Calls ---------------------------------------------------------------------------------------------

    def _x_call(self, node: ast.Call) -> Value:
        return self.call(node)

    def call(self, node: ast.Call, alone: bool = False, target: ast.expr | None = None) -> Value:
        """Return the value of a call; ``alone``: it is all of a statement, or of its right side."""
        returned, self.returning = self.returning, False
        if ast.Starred in map(type, node.args) or None in [k.arg for k in node.keywords]:
            raise self.refused("a star in a call", "name each argument")
        if isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
            return self._replaced(node, node.func.value)
        function = self.expression(node.func)
        if not isinstance(function.type, Static):
            raise self.refused(f"a call of {shown(function.type)}", "call a function")
        callee = function.type.value
        arguments = [self.expression(a) for a in node.args]
        named = {str(k.arg): self.expression(k.value) for k in node.keywords}
        if isinstance(callee, type) and issubclass(callee, tuple) and hasattr(callee, "_fields"):
            return self.made(callee, self._bound(callee, arguments, named))
        if isinstance(callee, FunctionType):
            self.returning = returned
            values = self._bound(callee, arguments, named)
            return self._function(callee, values, alone, target)
        if named:
            raise self.refused("named arguments of a built-in function", "leave out the names")
        return self._built_in(node, callee, arguments)

    def _replaced(self, node: ast.Call, owner: ast.expr) -> Value:
        value = self.expression(owner)
        t = value.type
        if not isinstance(t, RecordType) or t.kind is None or node.args:
            raise self.refused("_replace of what is no named tuple", "make a new tuple")
        parts = dict(zip(t.names, self.fields(value), strict=True))
        for keyword in node.keywords:
            if keyword.arg not in parts:
                raise self.refused(f"there is no field {keyword.arg}", "see the named tuple")
            before, new = parts[keyword.arg].type, self.expression(keyword.value)
            if joined(before, new.type) is None:
                problem = f"{keyword.arg} was {shown(before)}, and becomes {shown(new.type)}"
                raise self.refused(problem, "keep its type: 0.0 for 0")
            parts[keyword.arg] = new
        return self.made(t.kind, list(parts.values()))

    def _bound(self, callee: Any, given: list[Value], named: dict[str, Value]) -> list[Value]:
        """Return the values of a call in the order of what the callee takes, with defaults."""
        parameters = list(inspect.signature(callee).parameters.values())
        values = list(given)
        for parameter in parameters[len(given) :]:
            if parameter.name in named:
                values.append(named.pop(parameter.name))
            elif parameter.default is not inspect.Parameter.empty:
                values.append(self.program.value(parameter.default))
        if named or len(values) != len(parameters):
            takes = f"{callee.__name__} takes {', '.join(p.name for p in parameters)}"
            raise self.refused(takes, "give each of them once")
        return values

    def _function(
        self,
        callee: FunctionType,
        values: list[Value],
        alone: bool,
        target: ast.expr | None,
    ) -> Value:
        f = self.program.function(callee, [value.type for value in values])
        codes = [self._argument(value) for value in values if at_run_time(value.type)]
        if f.writes:
            self.writes = True
            if not alone:
                raise self.refused(
                    "it writes into an array", "assign its result on a line of its own"
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
