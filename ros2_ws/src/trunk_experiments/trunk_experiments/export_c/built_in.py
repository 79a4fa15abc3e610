"""Built-in functions of Python and of ``math`` as C."""

from __future__ import annotations

import ast
import builtins
import math
from typing import Any

from .body import FunctionBody
from .types import (
    BOOLEAN,
    INTEGER,
    INTEGERS,
    NATURAL,
    NUMBERS,
    REAL,
    Array,
    RecordType,
    Static,
    TableType,
    Type,
    Value,
)

_REMEDIES: dict[Any, tuple[str, str]] = {
    pow: ("it is the C library's pow", "multiply"),
    round: ("rounds halves to even numbers", "use math.floor(x + 0.5)"),
    divmod: ("two results of integers", "use // and %"),
    sum: ("sums are not translated", "add in a for loop"),
    enumerate: ("enumerate is not translated", "loop over range(len(...))"),
    zip: ("zip is not translated", "loop over range(len(...))"),
    all: ("all is not translated", "use and, or a for loop"),
    any: ("any is not translated", "use or, or a for loop"),
    isinstance: ("types are not values", "compare with is None"),
    tuple: ("tuples have a fixed length", "write the elements"),
    sorted: ("sorting is not translated", "compare the elements"),
    print: ("it prints", "return terms"),
}
_TO_INTEGER: dict[Any, str] = {
    math.floor: "floor_of",
    math.ceil: "ceiling_of",
    math.trunc: "truncated",
}


class BuiltIns(FunctionBody):
    """What `function.Translator` knows of built-in functions."""

    def _built_in(self, node: ast.Call, callee: Any, values: list[Value]) -> Value:
        types = [value.type for value in values]
        codes = [self.bare(value.code) for value in values]
        match callee, types:
            case builtins.len, [Array(dimensions=d)]:
                return Value(NATURAL, f"{values[0].code}.{'rows' if d == 2 else 'length'}")
            case builtins.len, [RecordType(kind=None) | TableType()]:
                return self.program.known(len(self.fields(values[0])))
            case ((builtins.min | builtins.max), [_, _, *_]):
                return self._extreme(callee is min, values)
            case ((builtins.abs | math.fabs), [t]) if t == REAL:
                return Value(REAL, f"real_abs({codes[0]})")
            case builtins.abs, [t] if t in INTEGERS:
                return Value(NATURAL, f"integer_abs({codes[0]})")
            case builtins.float, [t] if t in NUMBERS:
                return self.converted(values[0], REAL)
            case builtins.float, [Static(value=str())] if isinstance(node.args[0], ast.Constant):
                return self.program.value(float(str(node.args[0].value)))
            case builtins.int, [t] if t in INTEGERS:
                return values[0]
            case builtins.int, [t] if t == REAL:
                return Value(INTEGER, f"truncated({codes[0]})")
            case builtins.bool, [t] if t == BOOLEAN:
                return values[0]
            case builtins.bool, [t] if t in NUMBERS:
                return Value(BOOLEAN, f"({values[0].code} != {'0.0' if t == REAL else '0'})")
            case math.sqrt, [t] if t in NUMBERS:
                return Value(
                    REAL, f"square_root({self.bare(self.converted(values[0], REAL).code)})"
                )
            case math.copysign, [t, u] if t == u == REAL:
                return Value(REAL, f"with_sign({', '.join(codes)})")
            case math.isfinite, [t] if t == REAL:
                return Value(BOOLEAN, f"is_finite({codes[0]})")
            case math.isnan, [t] if t == REAL:
                value = self.in_memory(values[0], "number")
                return Value(BOOLEAN, f"({value.code} != {value.code})")
            case math.isinf, [t] if t == REAL:
                value = self.in_memory(values[0], "number")
                return Value(BOOLEAN, f"(!is_finite({value.code}) && {value.code} == {value.code})")
        if callee in _TO_INTEGER and types == [REAL]:
            return Value(INTEGER, f"{_TO_INTEGER[callee]}({codes[0]})")
        if callee in vars(math).values():
            raise self.refused("the C library rounds as it likes", "use those of trunk_control.api")
        known = callee in _REMEDIES if isinstance(callee, type | type(len)) else False
        default = ("this call is not translated", "call a plain function, or a named tuple")
        raise self.refused(*(_REMEDIES[callee] if known else default))

    def _extreme(self, least: bool, values: list[Value]) -> Value:
        if any(value.type not in NUMBERS for value in values):
            raise self.refused("min, max of what are no numbers", "give numbers")
        name = "min" if least else "max"
        if all(value.is_known for value in values):
            return self.program.known((min if least else max)(value.known for value in values))
        if any(value.type == REAL for value in values):
            if any(value.type in INTEGERS for value in values):
                raise self.refused(
                    "min, max of an int and a float", "write 0.0 for 0, or float(...)"
                )
            t: Type = REAL
            prefix = "real"
        else:
            naturals = [value.type == NATURAL for value in values]
            t = NATURAL if all(naturals) or (not least and any(naturals)) else INTEGER
            prefix = "integer"
        code = self.bare(values[0].code)
        for value in values[1:]:
            code = f"{prefix}_{name}({code}, {self.bare(value.code)})"
        return Value(t, code)
