"""What is compiled, without the compiler: a function with all that it calls, and records with arrays.

The functions that a pure function calls are also hashed and checked with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import CodeType, FunctionType
from typing import Any, TypeVar

import numpy as np

OURS = ("trunk_msgs_util", "trunk_sim", "trunk_control", "trunk_experiments")


def call_graph(function: Callable[..., Any]) -> list[FunctionType]:
    """Return a function and all that it calls, directly or not, of its own package and of this project.

    They are found through global names and, for a function built by a factory, its closure.
    """
    functions: list[FunctionType] = []
    waiting: list[Any] = [function]
    while waiting:
        callee = waiting.pop()
        if callee not in functions:
            functions.append(callee)
            waiting += _called(callee)
    return functions


def names_used(code: CodeType) -> tuple[str, ...]:
    """Return the global and attribute names in a function's code."""
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return (*code.co_names, *(name for constant in inner for name in names_used(constant)))


def _called(function: FunctionType) -> Iterator[FunctionType]:
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, FunctionType):
            yield cell.cell_contents
    packages = {*OURS, _package(function)}
    for name in names_used(function.__code__):
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType) and _package(value) in packages:
            yield value


def _package(function: FunctionType) -> str:
    return function.__module__.split(".")[0]


Record = TypeVar("Record")

_INTEGERS = {"pulse_starts", "table_times", "times", "turns_ns"}  # fields of ns


def with_arrays(record: Record) -> Record:
    """Return a named tuple with its tuples as arrays, so that its type does not include their lengths.

    Nested named tuples are treated likewise; anything else is returned unchanged.
    """
    if not hasattr(record, "_fields"):
        return record
    fields: Any = record
    made: Record = fields._make(
        np.array(value, dtype=np.int64 if name in _INTEGERS else np.float64)
        if type(value) is tuple
        else with_arrays(value)
        for name, value in zip(fields._fields, fields, strict=True)
    )
    return made
