"""``for`` over a range, a table, an array, or the elements of a tuple."""

from __future__ import annotations

import ast

from .assignment import Assignment
from .body import LocalVariable
from .layout import CodeBlock
from .types import (
    INTEGER,
    INTEGERS,
    NATURAL,
    Array,
    RecordType,
    Scalar,
    Static,
    TableType,
    Value,
    shown,
)


def for_loop(f: Assignment, node: ast.For) -> bool:
    """Translate a loop; return True if control never goes on behind it."""
    if node.orelse:
        raise f.refused("a loop has an else", "set a bool in the loop", node.target)
    if isinstance(node.iter, ast.Call) and f.expression(node.iter.func).type == Static(range):
        _over_range(f, node, node.iter)
        return False
    values = f.expression(node.iter)
    t = values.type
    if isinstance(t, Array) and t.dimensions == 1:
        i = f.temporary(INTEGER, "i")
        _repeat(
            f,
            node,
            i,
            "0",
            f"{values.code}.length",
            1,
            Value(t.element, f"{values.code}.data[{i}]", place=True),
        )
    elif isinstance(t, TableType):
        i = f.temporary(INTEGER, "i")
        _repeat(
            f, node, i, "0", str(t.length), 1, Value(t.element, f"{values.code}[{i}]", place=True)
        )
    elif isinstance(t, RecordType) and t.kind is None:
        return _unrolled(f, node, f.fields(values))
    else:
        raise f.refused(f"a loop over {shown(t)}", "loop over a range, or over a tuple", node.iter)
    return False


def _over_range(f: Assignment, node: ast.For, call: ast.Call) -> None:
    arguments = [f.expression(argument) for argument in call.args]
    if not 1 <= len(arguments) <= 3 or any(a.type not in INTEGERS for a in arguments):
        raise f.refused("a range of what are no ints", "give ints", call)
    first = arguments[0] if len(arguments) > 1 else f.program.known(0)
    stop = arguments[min(len(arguments) - 1, 1)]
    step = arguments[2] if len(arguments) == 3 else f.program.known(1)
    if not step.is_known or step.known == 0:
        raise f.refused("a step that is not known", "give a literal step", call)
    if first.is_known and stop.is_known and not range(first.known, stop.known, step.known):
        return
    end = f.bare(stop.code)
    if not stop.is_known:
        end = f.temporary(INTEGER, "stop")
        f.emit(f"{end} = {f.bare(stop.code)};", end, True)
    below = step.known > 0
    natural = first.type == NATURAL if below else stop.is_known and stop.known >= -1
    t = NATURAL if natural else INTEGER
    i = f.temporary(INTEGER, node.target.id if isinstance(node.target, ast.Name) else "i")
    _repeat(f, node, i, f.bare(first.code), end, step.known, Value(t, i, place=True))


def _repeat(
    f: Assignment, node: ast.For, i: str, first: str, end: str, step: int, item: Value
) -> None:
    change = f"{i}++" if step == 1 else f"{i}--" if step == -1 else f"{i} += {step}"
    sign = "<" if step > 0 else ">"
    del f.declared[i]
    loop = CodeBlock(f"for (int64_t {i} = {first}; {i} {sign} {end}; {change}) {{", loop=True)
    with f.inside(loop, loop=True):
        if _counter_alone(f, node) and item.code == i and isinstance(node.target, ast.Name):
            _named(f, node.target.id, item)
        else:
            f.assign(node.target, item)
        f.statements(node.body)
    f.block.body.append(loop)


def _counter_alone(f: Assignment, node: ast.For) -> bool:
    """Return True if the loop's variable is that of the loop alone: nobody else sets or reads it."""
    if not isinstance(node.target, ast.Name):
        return False
    name = node.target.id
    inside = sum(isinstance(n, ast.Name) and n.id == name for n in ast.walk(node))
    everywhere = sum(isinstance(n, ast.Name) and n.id == name for n in ast.walk(f.tree))
    return f.stores[name] == 1 and inside == everywhere and name not in f.variables


def _named(f: Assignment, name: str, value: Value) -> None:
    f.variables[name] = LocalVariable(value.type, value, f.block)


def _unrolled(f: Assignment, node: ast.For, items: list[Value]) -> bool:
    """Translate a loop over a tuple: in a loop over its numbers, or element by element."""
    if items and all(isinstance(item.type, Scalar) and item.is_known for item in items):
        table = TableType(INTEGER, len(items))
        c = f.program.table([item.known for item in items], table, "items")
        i = f.temporary(INTEGER, "i")
        natural = all(item.known >= 0 for item in items)
        element = Value(NATURAL if natural else INTEGER, f"{c}[{i}]", place=True)
        _repeat(f, node, i, "0", str(len(items)), 1, element)
        return False
    held = [f.copied(item, "item") if item.code and not item.is_known else item for item in items]
    loops, f.loops = f.loops, 0
    try:
        for item in held:
            f.assign(node.target, item)
            if f.statements(node.body):
                return True
    finally:
        f.loops = loops
    return False
