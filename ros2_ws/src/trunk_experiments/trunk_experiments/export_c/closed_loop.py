"""The whole closed loop of a plan as one C text: plant, sensors, links, disturbances and controllers.

The text has the plan's numbers as static variables, ``trunk_loop_run()``, and a function for each array that
the caller fills or reads; compiled to WASM it needs nothing from outside.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .emit import library
from .translate import Program
from .types import REAL, Array, RecordType, Type, at_run_time, type_of

_INLINE = 64  # longer arrays are for the caller to fill
_NAMES = ("states", "surroundings", "state", "participants", "noise", "history", "schedule", "out")


@dataclass
class LoopArray:
    """An array of the loop: the C function that returns it, and its values in the plan."""

    function: str
    values: Any
    inline: bool  # its values are in the text


@dataclass
class ClosedLoop:
    """A plan's loop in C, and its arrays by the paths of their names."""

    text: str
    arrays: dict[str, LoopArray]


def closed_loop(loop: Any, arguments: tuple[Any, ...]) -> ClosedLoop:
    """Return the loop of `batch.compiled_run.loop_of` with its arguments as C. Raises UntranslatableError."""
    program = Program()
    program.names |= {"states", "state", "count", "diverged", *_NAMES}
    types = [type_of(argument) for argument in arguments]
    f = program.function(loop, types)
    arrays: dict[str, LoopArray] = {}
    statics, functions, given = [], [], []
    for name, value, t in zip(_NAMES, arguments, types, strict=True):
        for path, array, kind in arrays_of(name, value, t):
            statics.append(storage(program, path, array, kind))
            function = f"trunk_loop_{path}"
            functions.append(f"{kind.element.c} *{function}(void);")
            functions.append(f"{kind.element.c} *{function}(void) {{\n    return {path}_data;\n}}")
            arrays[path] = LoopArray(function, array, array.size <= _INLINE)
        if not at_run_time(t):
            continue
        if isinstance(t, RecordType):
            statics.append(
                f"static {program.c_type(t)} {name} = {initial(program, name, value, t)};"
            )
            given.append(f"&{name}")
        elif isinstance(t, Array):
            statics.append(f"static {program.c_type(t)} {name} = {array_in_c(name, value)};")
            given.append(name)
        else:
            given.append(program.literal(value))
    run = f"""static bool diverged;

int64_t trunk_loop_run(void);
int64_t trunk_loop_run(void) {{
    int64_t count;
    {f.name}({", ".join(given)}, &count, &diverged);
    return count;
}}

bool trunk_loop_diverged(void);
bool trunk_loop_diverged(void) {{
    return diverged;
}}"""
    tail = "\n\n".join([*statics, *functions, run])
    return ClosedLoop(f"{library(program, tail)}\n{tail}\n", arrays)


def arrays_of(path: str, value: Any, t: Type) -> Iterator[tuple[str, Any, Array]]:
    """Yield the arrays in a value of a type: path, array and type of each."""
    if isinstance(t, Array):
        yield path, value, t
    elif isinstance(t, RecordType):
        for name, item, inner in zip(t.names, value, t.types, strict=True):
            yield from arrays_of(f"{path}_{name}", item, inner)


def storage(program: Program, path: str, array: Any, t: Array) -> str:
    """Return the declaration of an array's elements, ``PATH_data``, with its values if they are few."""
    count = max(int(array.size), 1)
    if array.size > _INLINE or path in ("out", "history"):
        return f"static {t.element.c} {path}_data[{count}];"
    flat = np.ascontiguousarray(array).reshape(-1).tolist() or [0]
    items = ", ".join(program.literal(float(v) if t.element == REAL else int(v)) for v in flat)
    return f"static {t.element.c} {path}_data[{count}] = {{{items}}};"


def array_in_c(path: str, array: Any) -> str:
    """Return the initializer of an array whose elements are ``PATH_data``."""
    return f"{{{path}_data, {', '.join(str(n) for n in array.shape)}}}"


def initial(program: Program, path: str, value: Any, t: Type) -> str:
    """Return the initializer of a value whose arrays are stored by their paths."""
    if isinstance(t, Array):
        return array_in_c(path, value)
    if not isinstance(t, RecordType):
        return program.initial(value, t)
    items = [
        initial(program, f"{path}_{name}", item, inner)
        for name, item, inner in zip(t.names, value, t.types, strict=True)
        if at_run_time(inner)
    ]
    inside = ", ".join(items)
    return f"{{{{{inside}}}}}" if t.row else f"{{{inside}}}"
