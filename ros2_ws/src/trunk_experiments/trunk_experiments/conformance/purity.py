"""What a pure function may contain: no state, clock, randomness or file; the same bits on every machine."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

from trunk_core.compiled import call_graph
from trunk_core.elementary import LARGEST_ANGLE

from .kit import Check, Finding, Plugin, name_of

# Exact, or rounded correctly everywhere.
_EXACT = {
    *("inf", "nan", "pi", "tau", "e", "floor", "ceil", "trunc", "sqrt", "fabs", "copysign"),
    *("isfinite", "isinf", "isnan", "fmod", "nextafter", "ulp"),
}
_BUILTINS = {
    *("abs", "bool", "divmod", "enumerate", "float", "int", "len", "max", "min", "range", "round"),
    *("tuple", "zip", "isinstance", "all", "any", "True", "False", "None"),
}
_PORTABLE = "portable"
_OURS = ("trunk_control.", "trunk_core.")


class Contract(NamedTuple):
    """What is asked of a kind of plug-in, as advice has it."""

    noun: str  # "law"
    api: str  # the module with its functions
    keep: str  # where state belongs

    @property
    def portable(self) -> str:
        """What to call instead of the machine's own mathematical functions."""
        return (
            f"use sin, cos, atan2, exp, log, tanh, sqrt of {self.api}: the same bits on every machine, "
            f"and NaN from sin and cos beyond +-{LARGEST_ANGLE:.0f} rad"
        )


def functions_from(roots: Iterable[object]) -> list[FunctionType]:
    """Return functions, and those of their own package that they call."""
    graphs = (call_graph(root) for root in roots if isinstance(root, FunctionType))
    return list(dict.fromkeys(function for graph in graphs for function in graph))


def _pure(roots: Sequence[object], contract: Contract) -> Iterator[Finding]:
    """Yield a finding where a function keeps state, reads a clock, draws at random or touches files.

    ``roots``: functions that are checked with all that they call.
    """
    for root in roots:
        if not isinstance(root, FunctionType):
            yield Finding(
                repr(root),
                f"is a {type(root).__name__}",
                "a plain function is needed: its source is hashed, compiled and checked",
            )
    yield from _problems_in(roots, contract, portable=False)


def source_checks(
    roots_of: Callable[[Plugin], Sequence[object]], contract: Contract
) -> Iterator[Check[Plugin]]:
    """Yield the checks of the source of a kind of plug-in."""
    yield Check(
        "source",
        "no state, clock, randomness or file in its source",
        lambda plugin: _pure(roots_of(plugin), contract),
    )
    yield Check(
        _PORTABLE,  # no function whose rounding depends on the machine's mathematical library
        "the same bits on every machine",
        lambda plugin: _problems_in(roots_of(plugin), contract, portable=True),
    )


def _problems_in(roots: Sequence[object], contract: Contract, portable: bool) -> Iterator[Finding]:
    for function in functions_from(roots):
        for problem in problems(function, contract):
            if (problem.check == _PORTABLE) == portable:
                yield problem


def problems(function: FunctionType, contract: Contract) -> Iterator[Finding]:
    """Yield what a function does that a pure and portable one does not; of the latter, so marked."""
    if function.__module__.startswith(_OURS):
        return
    where = name_of(function)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError):
        yield Finding(where, "has no source that can be read", "define it in a file")
        return
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, list | dict | set):
            yield Finding(where, "keeps a mutable object in its closure", contract.keep)
    for value in function.__defaults__ or ():
        if isinstance(value, list | dict | set):
            yield Finding(where, f"has the mutable default {value!r}", contract.keep)
    reported = set()
    whole = tree.body[0]
    # Annotations and decorators do not run with it.
    parts = whole.body if isinstance(whole, ast.FunctionDef) else [whole]
    for node in (node for part in parts for node in ast.walk(part)):
        for finding in _of_node(node, function, where, contract):
            if finding.problem not in reported:
                reported.add(finding.problem)
                yield finding


def _of_node(
    node: ast.AST, function: FunctionType, where: str, contract: Contract
) -> Iterator[Finding]:
    if isinstance(node, ast.Global | ast.Nonlocal):
        yield Finding(where, f"changes {', '.join(node.names)} outside itself", contract.keep)
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield Finding(where, "imports while it runs", "import at the top of the module")
    elif isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
        target = ast.unparse(node)
        yield Finding(where, f"writes to {target}", contract.keep)
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        yield from _power(node, node.left, node.right, where, contract)
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Pow):
        yield from _power(node, node.target, node.value, where, contract)
    elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
        yield from _of_value(node, function, where, contract)


def _power(
    node: ast.AST, base: ast.expr, exponent: ast.expr, where: str, contract: Contract
) -> Iterator[Finding]:
    """Yield a power that is not of whole numbers: CPython calls libm's pow where compiled code multiplies."""
    times = exponent.value if isinstance(exponent, ast.Constant) else None
    if isinstance(base, ast.Constant) and isinstance(base.value, int) and isinstance(times, int):
        return
    advice = f"use exp and log of {contract.api}, or multiply"
    if isinstance(times, int | float) and times in (2, 3, 4):
        factor = ast.unparse(base) if isinstance(base, ast.Constant) else f"({ast.unparse(base)})"
        advice = f"write {' * '.join([factor] * int(times))}"
    yield Finding(where, f"computes {ast.unparse(node)}", advice, check=_PORTABLE)


def _of_value(
    node: ast.expr, function: FunctionType, where: str, contract: Contract
) -> Iterator[Finding]:
    known, value = _resolved(node, function)
    if not known:
        return
    shown = ast.unparse(node)
    if isinstance(value, list | dict | set | bytearray):
        yield Finding(
            where, f"uses {shown}, a {type(value).__name__} that may change", contract.keep
        )
        return
    if isinstance(value, ModuleType | type):
        return
    module = getattr(value, "__module__", None) or ""
    if getattr(builtins, getattr(value, "__name__", ""), None) is value:
        if shown not in _BUILTINS:
            yield Finding(where, f"calls {shown}", f"a {contract.noun} computes, and nothing else")
    elif module == "math" or getattr(math, shown.rsplit(".", 1)[-1], None) is value:
        if shown.rsplit(".", 1)[-1] not in _EXACT and callable(value):
            yield Finding(where, f"calls {shown}", contract.portable, check=_PORTABLE)
    elif module.split(".")[0] == "numpy" or type(value).__module__.split(".")[0] == "numpy":
        if callable(value):
            yield Finding(where, f"calls {shown} of NumPy", contract.portable, check=_PORTABLE)
        elif not isinstance(value, float):
            yield Finding(where, f"uses {shown}, an array that may change", contract.keep)
    elif callable(value) and not isinstance(value, FunctionType):
        yield Finding(
            where,
            f"calls {shown} of {module or type(value).__module__}",
            f"no clock, no randomness, no files: a {contract.noun} computes from what it is given",
        )
    elif isinstance(value, FunctionType) and value not in call_graph(function):
        yield Finding(
            where,
            f"calls {shown} of {value.__module__}, which is not checked",
            f"no clock, no randomness, no files: a {contract.noun} computes from what it is given",
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
