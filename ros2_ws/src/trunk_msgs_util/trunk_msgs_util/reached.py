"""Which functions a pure function calls: what is compiled with it, hashed with it and checked with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import CodeType, FunctionType
from typing import Any

_OURS = ("trunk_msgs_util", "trunk_sim", "trunk_control", "trunk_experiments")


def reached(function: Callable[..., Any]) -> list[FunctionType]:
    """Return a function and all that it calls, directly or not, of its own package and of this project.

    They are found through global names and, for a function built by a factory, its closure.
    """
    found: list[FunctionType] = []
    waiting: list[Any] = [function]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.append(one)
            waiting += _called(one)
    return found


def names_used(code: CodeType) -> tuple[str, ...]:
    """Return the global and attribute names in a function's code."""
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return (*code.co_names, *(name for one in inner for name in names_used(one)))


def _called(function: FunctionType) -> Iterator[FunctionType]:
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, FunctionType):
            yield cell.cell_contents
    packages = {*_OURS, _package(function)}
    for name in names_used(function.__code__):
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType) and _package(value) in packages:
            yield value


def _package(function: FunctionType) -> str:
    return function.__module__.split(".")[0]
