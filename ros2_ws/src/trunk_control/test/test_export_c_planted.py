"""Faults planted in the translator: the tests of its bits find each."""

import ast

import pytest

from trunk_core.c import program, translate
from trunk_core.c.types import BOOLEAN, UntranslatableError, Value

from ...trunk_core.test.c_programs import needs_compiler
from . import translatable as t
from .test_export_c_functions import differences

pytestmark = [needs_compiler, pytest.mark.slow]


def helper(name, old, new):
    """Change a helper's text."""

    def plant(monkeypatch):
        text = program.HELPERS[name]
        assert old in text
        monkeypatch.setitem(program.HELPERS, name, text.replace(old, new))

    return plant


def attribute(owner, name, new):
    """Replace an attribute of a class or a module."""
    return lambda monkeypatch: monkeypatch.setattr(owner, name, new)


def changed(owner, name, change):
    """Change what a method returns."""
    before = getattr(owner, name)
    return attribute(owner, name, lambda self, *a, **k: change(before(self, *a, **k)))


def not_greater_is_less(monkeypatch):
    before = translate._Function._x_unaryop

    def wrong(self, node):
        inner = node.operand
        if isinstance(node.op, ast.Not) and isinstance(inner, ast.Compare):
            opposite = ast.copy_location(
                ast.Compare(inner.left, [ast.LtE()], inner.comparators), inner
            )
            return self.expression(opposite)
        return before(self, node)

    monkeypatch.setattr(translate._Function, "_x_unaryop", wrong)


def globals_first(monkeypatch):
    before = translate._Function._x_name

    def wrong(self, node):
        known = node.id in self.python.__globals__
        if (
            known
            and node.id not in self.python.__code__.co_varnames[: self.python.__code__.co_argcount]
        ):
            node = ast.copy_location(ast.Name(node.id, ast.Load()), node)
            value = self.python.__globals__[node.id]
            return self._outer(node, value, node.id)
        return before(self, node)

    monkeypatch.setattr(translate._Function, "_x_name", wrong)


def names_ignored(monkeypatch):
    before = translate._Function._bound

    def wrong(self, callee, given, named):
        return before(self, callee, [*given, *named.values()], {})

    monkeypatch.setattr(translate._Function, "_bound", wrong)


def field_by_field(monkeypatch):
    """A record that reads itself is set field by field."""
    monkeypatch.setattr(translate._Function, "store", translate._Function._fill)


def every_branch(monkeypatch):
    """A condition's statements are not put behind what decides before."""

    def wrong(self, node):
        terms = [self.expression(operand).code for operand in node.values]
        return Value(BOOLEAN, f"({' || '.join(terms)})")

    monkeypatch.setattr(translate._Function, "_x_boolop", wrong)


def reversed_results(monkeypatch):
    before = translate._Function.fields

    def wrong(self, value):
        return before(self, value)[:: 1 if value.parts is not None else -1]

    monkeypatch.setattr(translate._Function, "fields", wrong)


def or_for_and(value):
    return Value(value.type, value.code.replace("&&", "||"), value.known)


FAULTS = {
    "integer division truncates": (helper("floor_div", "q - 1 : q", "q : q"), t.integer_division),
    "the remainder has the dividend's sign": (
        helper("floor_mod", "r + b : r", "r : r"),
        t.integer_division,
    ),
    "a quotient of long integers is rounded twice": (
        helper(
            "quotient", "if (a >= -exact && a <= exact && b >= -exact && b <= exact)", "if (b != 0)"
        ),
        t.wide_integers,
    ),
    "min in the other order": (
        helper("real_min", "b < a ? b : a", "a < b ? a : b"),
        t.least_and_greatest,
    ),
    "max in the other order": (
        helper("real_max", "b > a ? b : a", "a > b ? a : b"),
        t.least_and_greatest,
    ),
    "not a > b is a <= b": (not_greater_is_less, t.nan_comparisons),
    "a chain of comparisons is or": (
        changed(translate._Function, "_x_compare", or_for_and),
        t.chained,
    ),
    "results in the other order": (reversed_results, t.several_results),
    "parallel assignment one by one": (
        attribute(translate._Function, "reads", lambda self, *_: False),
        t.swaps,
    ),
    "a local name means the global": (globals_first, t.shadows),
    "named arguments by place": (names_ignored, t.calls_with_names),
    "negative indices are 0": (helper("index_in", "i + length", "0"), t.indices),
    "floor truncates": (helper("floor_of", "i - 1 : i", "i : i"), t.numbers),
    "abs keeps the sign of -0.0": (helper("real_abs", "x + 0.0", "x"), t.numbers),
    "constants in fifteen digits": (
        attribute(program, "definition", lambda number: f"{number:.15g}"),
        t.elementary,
    ),
    "a record that reads itself is set field by field": (field_by_field, t.keeps_order),
    "and, or evaluate everything": (every_branch, t.short_circuits),
    "- adds": (
        lambda monkeypatch: monkeypatch.setitem(translate._ARITHMETIC, ast.Sub, ("+", int.__sub__)),
        t.swaps,
    ),
    "an element too early": (
        lambda monkeypatch: monkeypatch.setattr(
            translate.Program,
            "table",
            lambda self, values, kind, name="table", b=translate.Program.table: b(
                self, (*values[1:], values[0]), kind, name
            ),
        ),
        t.indices,
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(fault, monkeypatch):
    plant, translated = FAULTS[fault]
    plant(monkeypatch)
    assert is_found(translated)


def is_found(translated):
    """Return whether bits differ, or there is nothing to compare."""
    try:
        return differences(translated, t.CALLS[translated], flags=("-O1", "-Wno-error")) != []
    except UntranslatableError:
        return True
    except AssertionError as error:  # of the compiler
        return "error:" in str(error)
