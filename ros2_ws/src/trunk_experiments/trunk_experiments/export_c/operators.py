"""Operators of Python as C: conditions, comparisons, arithmetic."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from typing import Any

from .calls import Calls
from .layout import CodeBlock
from .types import (
    BOOLEAN,
    INTEGER,
    INTEGERS,
    NATURAL,
    NOTHING,
    NUMBERS,
    REAL,
    Array,
    RecordType,
    Scalar,
    Static,
    TableType,
    Value,
    joined,
    shown,
)

_ARITHMETIC: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
}
_BITS: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.BitAnd: ("&", operator.and_),
    ast.BitOr: ("|", operator.or_),
    ast.BitXor: ("^", operator.xor),
    ast.LShift: ("<<", operator.lshift),
    ast.RShift: (">>", operator.rshift),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}
_WIDEST = 2**63


class Operators(Calls):
    """What `function.Translator` knows of operators."""

    # Truth ---------------------------------------------------------------------------------------------

    def truth(self, node: ast.expr) -> Value:
        """Return an expression as a condition; known where its type decides."""
        value = self.expression(node)
        t = value.type
        if value.is_known:
            return self.program.known(bool(value.known))
        if t == BOOLEAN:
            return value
        if t == NOTHING:
            return self.program.known(False)
        if t in INTEGERS:
            return Value(BOOLEAN, f"({value.code} != 0)")
        if t == REAL:
            return Value(BOOLEAN, f"({value.code} != 0.0)")
        if isinstance(t, TableType) or (isinstance(t, RecordType) and t.kind is None):
            return self.program.known(bool(t.length if isinstance(t, TableType) else t.types))
        raise self.refused(
            f"{shown(t)} as a condition", "compare with is None, or len() with 0", node
        )

    def _x_boolop(self, node: ast.BoolOp) -> Value:
        conjunction = isinstance(node.op, ast.And)
        sign = " && " if conjunction else " || "
        terms: list[str] = []
        for operand in node.values:
            branch = CodeBlock()
            with self.inside(branch):
                value = self.expression(operand)
            if value.type == NOTHING:
                value = self.program.known(False)
            if value.type != BOOLEAN:
                raise self.refused(
                    f"and, or of {shown(value.type)}", "compare it with something", operand
                )
            if value.is_known:
                if bool(value.known) != conjunction:  # it decides, whatever the others are
                    return self.program.known(not conjunction)
                continue
            if not terms:
                self.block.body += branch.body
            elif branch.body:  # evaluated only if the ones before do not decide
                c = self.temporary(BOOLEAN, "both" if conjunction else "either")
                self.emit(f"{c} = {sign.join(terms)};", c)
                self.block.body.append(
                    CodeBlock(f"if ({c if conjunction else f'!{c}'}) {{", branch.body)
                )
                with self.inside(branch):
                    self.emit(f"{c} = {self.bare(value.code)};")
                terms = [c]
                continue
            terms.append(value.code)
        if not terms:
            return self.program.known(conjunction)
        return Value(BOOLEAN, terms[0] if len(terms) == 1 else f"({sign.join(terms)})")

    def _x_compare(self, node: ast.Compare) -> Value:
        operands = [self.expression(n) for n in (node.left, *node.comparators)]
        terms = []
        for a, b, op in zip(operands, operands[1:], node.ops, strict=False):
            term = self._comparison(a, b, op)
            if term.is_known and not term.known:
                return term
            if not term.is_known:
                terms.append(term.code)
        if not terms:
            return self.program.known(True)
        code = terms[0] if len(terms) == 1 else f"({' && '.join(terms)})"
        return Value(BOOLEAN, code)

    def _comparison(self, a: Value, b: Value, op: ast.cmpop) -> Value:
        if isinstance(op, ast.Is | ast.IsNot):
            if NOTHING not in (a.type, b.type):
                raise self.refused("is of what is not None", "compare with ==")
            return self.program.known((a.type == b.type) == isinstance(op, ast.Is))
        if isinstance(op, ast.In | ast.NotIn):
            raise self.refused("in is not translated", "compare with == and or")
        sign, compute = _COMPARISONS[type(op)]
        if a.is_known and b.is_known:
            return self.program.known(bool(compute(a.known, b.known)))
        equality = isinstance(op, ast.Eq | ast.NotEq)
        if isinstance(a.type, RecordType) and equality:
            if a.type != b.type:
                raise self.refused(
                    f"{shown(a.type)} compared with {shown(b.type)}", "compare the elements"
                )
            return self._equal(a, b, op)
        if a.type == b.type == BOOLEAN and equality:
            return Value(BOOLEAN, f"({a.code} {sign} {b.code})")
        if a.type not in NUMBERS or b.type not in NUMBERS:
            raise self.refused(f"{shown(a.type)} compared with {shown(b.type)}", "compare numbers")
        if REAL in (a.type, b.type):
            for value in (a, b):
                if value.type in INTEGERS and not (value.is_known and abs(value.known) <= 2**53):
                    raise self.refused("an int compared with a float", "compare float(...) of it")
            a, b = (self.converted(value, REAL) for value in (a, b))
        return Value(BOOLEAN, f"({a.code} {sign} {b.code})")

    def _equal(self, a: Value, b: Value, op: ast.cmpop) -> Value:
        terms = [
            self._comparison(x, y, ast.Eq())
            for x, y in zip(self.fields(a), self.fields(b), strict=True)
        ]
        code = " && ".join(term.code for term in terms) or "true"
        return Value(BOOLEAN, f"({code})" if isinstance(op, ast.Eq) else f"(!({code}))")

    def _x_ifexp(self, node: ast.IfExp) -> Value:
        test = self.truth(node.test)
        if test.is_known:
            return self.expression(node.body if test.known else node.orelse)
        branches = []
        for arm in (node.body, node.orelse):
            block = CodeBlock()
            with self.inside(block):
                branches.append((block, self.expression(arm)))
        (then, a), (other, b) = branches
        t = joined(a.type, b.type)
        if t is None or isinstance(t, Static | Array | TableType):
            problem = f"it is {shown(a.type)} or {shown(b.type)}"
            raise self.refused(problem, "give both the same type: 0.0 for 0")
        if t == NOTHING:
            return a
        if isinstance(t, Scalar) and not then.body and not other.body:
            return Value(t, f"({test.code} ? {a.code} : {b.code})")
        c = self.temporary(t, "either")
        for block, value, head in (
            (then, a, f"if ({self.bare(test.code)}) {{"),
            (other, b, "else {"),
        ):
            block.head = head
            self.block.body.append(block)
            with self.inside(block):
                self.store(c, value)
        return Value(t, c, place=True)

    # Arithmetic ----------------------------------------------------------------------------------------

    def _x_unaryop(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            test = self.truth(node.operand)
            return (
                self.program.known(not test.known)
                if test.is_known
                else Value(BOOLEAN, f"!{test.code}")
            )
        value = self.expression(node.operand)
        t = value.type
        if t not in NUMBERS or (isinstance(node.op, ast.Invert) and t == REAL):
            raise self.refused(f"a sign of {shown(t)}", "compute with numbers")
        if isinstance(node.op, ast.UAdd):
            return value
        if value.is_known:
            return self._fitting(
                ~value.known if isinstance(node.op, ast.Invert) else -value.known
            )
        sign = "~" if isinstance(node.op, ast.Invert) else "-"
        return Value(REAL if t == REAL else INTEGER, f"({sign}{self.tight(value.code)})")

    def _x_binop(self, node: ast.BinOp) -> Value:
        if isinstance(node.op, ast.Pow):
            base = ast.unparse(node.left)
            raise self.refused(
                "CPython's ** calls the C library's pow", f"multiply: {base} * {base}"
            )
        a, b = self.expression(node.left), self.expression(node.right)
        t, u, op = a.type, b.type, type(node.op)
        if t not in NUMBERS or u not in NUMBERS:
            raise self.refused(f"{shown(t)} and {shown(u)}", "compute with numbers")
        if op is ast.Div:
            if REAL in (t, u):
                a, b = (self.converted(value, REAL) for value in (a, b))
                return Value(REAL, f"({a.code} / {b.code})")
            return Value(REAL, f"quotient({self.bare(a.code)}, {self.bare(b.code)})")
        if op in _ARITHMETIC:
            return self._sum(a, b, *_ARITHMETIC[op])
        if REAL in (t, u):
            raise self.refused("this operator on floats", "use math.floor and multiply")
        if op in (ast.FloorDiv, ast.Mod):
            return self._division(a, b, op)
        if op in _BITS:
            sign, compute = _BITS[op]
            if a.is_known and b.is_known:
                return self._fitting(compute(a.known, b.known))
            shift = op in (ast.LShift, ast.RShift)
            if shift and not (b.is_known and 0 <= b.known < 63):
                raise self.refused("a shift by what is not known", "shift by a literal")
            if op is ast.LShift:
                return Value(t, f"({a.code} * {self.program.literal(1 << b.known)})")
            natural = t == NATURAL and (shift or u == NATURAL)
            return Value(NATURAL if natural else INTEGER, f"({a.code} {sign} {b.code})")
        raise self.refused("this operator is not translated", "use + - * / // %")

    def _sum(self, a: Value, b: Value, sign: str, compute: Callable[[Any, Any], Any]) -> Value:
        if REAL in (a.type, b.type):
            a, b = (self.converted(value, REAL) for value in (a, b))
            return Value(REAL, f"({a.code} {sign} {b.code})")
        if a.is_known and b.is_known:
            return self._fitting(compute(a.known, b.known))
        natural = a.type == b.type == NATURAL and sign != "-"
        return Value(NATURAL if natural else INTEGER, f"({a.code} {sign} {b.code})")

    def _division(self, a: Value, b: Value, op: type[ast.operator]) -> Value:
        floor = op is ast.FloorDiv
        if b.is_known and b.known == 0:
            raise self.refused("a division by 0", "divide by what is not 0")
        if a.is_known and b.is_known:
            return self._fitting(a.known // b.known if floor else a.known % b.known)
        natural = b.type == NATURAL and (a.type == NATURAL or not floor)
        if a.type == NATURAL and b.is_known and b.known > 0:
            return Value(NATURAL, f"({a.code} {'/' if floor else '%'} {b.code})")
        name = "floor_div" if floor else "floor_mod"
        code = f"{name}({self.bare(a.code)}, {self.bare(b.code)})"
        return Value(NATURAL if natural else INTEGER, code)

    def _fitting(self, number: int) -> Value:
        if not -_WIDEST <= number < _WIDEST:
            raise self.refused(f"{number} has more than 64 bits", "use smaller numbers")
        return self.program.known(number)
