"""Checks of a law's source: no state outside the memory, no clock, no randomness, no files, no libm."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Iterator
from types import FunctionType, ModuleType
from typing import Any

from trunk_control.law import Law, from_scratch, unchanged
from trunk_msgs_util.compiled import call_graph

from .finding import LawFinding, name_of

# Exact, or rounded correctly everywhere.
_EXACT = {
    *("inf", "nan", "pi", "tau", "e", "floor", "ceil", "trunc", "sqrt", "fabs", "copysign"),
    *("isfinite", "isinf", "isnan", "fmod", "nextafter", "ulp"),
}
_BUILTINS = {
    *("abs", "bool", "divmod", "enumerate", "float", "int", "len", "max", "min", "range", "round"),
    *("tuple", "zip", "isinstance", "all", "any", "True", "False", "None"),
}
_OURS = ("trunk_control.", "trunk_msgs_util.")
_PORTABLE = (
    "use sin, cos, atan2, exp, log, tanh, sqrt of trunk_control.api: the same bits on every machine"
)


def functions_of(law: Law) -> list[FunctionType]:
    """Return the law's functions, and those of its own package that they call."""
    roots: list[Any] = [law.update]
    roots += [
        function
        for function in (law.transfer, law.reconfigure)
        if function not in (from_scratch, unchanged)
    ]
    if law.lookup is not None:
        roots += [law.lookup.inputs, law.lookup.cell, law.lookup.near]
    functions: dict[FunctionType, None] = {}
    for root in roots:
        if isinstance(root, FunctionType):
            functions.update(dict.fromkeys(call_graph(root)))
    return list(functions)


def pure_source(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a function keeps state, reads a clock, draws at random or touches files."""
    if not isinstance(law.update, FunctionType):
        yield LawFinding(
            "source",
            repr(law.update),
            f"is a {type(law.update).__name__}",
            "a plain function is needed: its source is hashed, compiled and checked",
        )
    for function in functions_of(law):
        for problem in _problems(function):
            if problem.check == "source":
                yield problem


def portable_source(law: Law) -> Iterator[LawFinding]:
    """Yield calls of functions whose rounding depends on the machine's mathematical library."""
    for function in functions_of(law):
        for problem in _problems(function):
            if problem.check == "portable":
                yield problem


def _problems(function: FunctionType) -> Iterator[LawFinding]:
    if function.__module__.startswith(_OURS):
        return
    where = name_of(function)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError):
        yield LawFinding("source", where, "has no source that can be read", "define it in a file")
        return
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, list | dict | set):
            yield _state(where, "keeps a mutable object in its closure")
    for value in function.__defaults__ or ():
        if isinstance(value, list | dict | set):
            yield _state(where, f"has the mutable default {value!r}")
    reported = set()
    for node in ast.walk(tree):
        for finding in _of_node(node, function, where):
            if finding.problem not in reported:
                reported.add(finding.problem)
                yield finding


def _of_node(node: ast.AST, function: FunctionType, where: str) -> Iterator[LawFinding]:
    if isinstance(node, ast.Global | ast.Nonlocal):
        yield _state(where, f"changes {', '.join(node.names)} outside itself")
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield LawFinding(
            "source", where, "imports while it runs", "import at the top of the module"
        )
    elif isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
        target = ast.unparse(node)
        yield _state(where, f"writes to {target}")
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        yield from _power(node, node.left, node.right, where)
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Pow):
        yield from _power(node, node.target, node.value, where)
    elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
        yield from _of_value(node, function, where)


def _power(node: ast.AST, base: ast.expr, exponent: ast.expr, where: str) -> Iterator[LawFinding]:
    """Yield a power that is not of whole numbers: CPython calls libm's pow where compiled code multiplies."""
    times = exponent.value if isinstance(exponent, ast.Constant) else None
    if isinstance(base, ast.Constant) and isinstance(base.value, int) and isinstance(times, int):
        return
    advice = "use exp and log of trunk_control.api, or multiply"
    if isinstance(times, int | float) and times in (2, 3, 4):
        factor = ast.unparse(base) if isinstance(base, ast.Constant) else f"({ast.unparse(base)})"
        advice = f"write {' * '.join([factor] * int(times))}"
    yield LawFinding("portable", where, f"computes {ast.unparse(node)}", advice)


def _of_value(node: ast.expr, function: FunctionType, where: str) -> Iterator[LawFinding]:
    known, value = _resolved(node, function)
    if not known:
        return
    shown = ast.unparse(node)
    if isinstance(value, list | dict | set | bytearray):
        yield _state(where, f"uses {shown}, a {type(value).__name__} that may change")
        return
    if isinstance(value, ModuleType | type):
        return
    module = getattr(value, "__module__", None) or ""
    if getattr(builtins, getattr(value, "__name__", ""), None) is value:
        if shown not in _BUILTINS:
            yield LawFinding("source", where, f"calls {shown}", "a law computes, and nothing else")
    elif module == "math" or getattr(math, shown.rsplit(".", 1)[-1], None) is value:
        if shown.rsplit(".", 1)[-1] not in _EXACT and callable(value):
            yield LawFinding("portable", where, f"calls {shown}", _PORTABLE)
    elif module.split(".")[0] == "numpy" or type(value).__module__.split(".")[0] == "numpy":
        if callable(value):
            yield LawFinding("portable", where, f"calls {shown} of NumPy", _PORTABLE)
        elif not isinstance(value, float):
            yield _state(where, f"uses {shown}, an array that may change")
    elif callable(value) and not isinstance(value, FunctionType):
        yield LawFinding(
            "source",
            where,
            f"calls {shown} of {module or type(value).__module__}",
            "no clock, no randomness, no files: a law computes from what it is given",
        )
    elif isinstance(value, FunctionType) and value not in call_graph(function):
        yield LawFinding(
            "source",
            where,
            f"calls {shown} of {value.__module__}, which is not checked",
            "no clock, no randomness, no files: a law computes from what it is given",
        )


def _resolved(node: ast.expr, function: FunctionType) -> tuple[bool, Any]:
    """Return whether a name is global or built in, and its value; attributes of modules likewise."""
    if isinstance(node, ast.Name):
        if node.id in function.__code__.co_varnames or node.id in function.__code__.co_freevars:
            return False, None
        if node.id in function.__globals__:
            return True, function.__globals__[node.id]
        if hasattr(builtins, node.id):
            return True, getattr(builtins, node.id)
        return False, None
    if isinstance(node, ast.Attribute):
        known, owner = _resolved(node.value, function)
        if known and isinstance(owner, ModuleType | type) and hasattr(owner, node.attr):
            return True, getattr(owner, node.attr)
        if known and isinstance(owner, FunctionType):
            return True, [owner]  # an attribute of a function is state
    return False, None


def _state(where: str, fault: str) -> LawFinding:
    return LawFinding("source", where, fault, "keep everything in the memory that update returns")
