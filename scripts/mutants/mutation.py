"""The mutants of a module: cosmic-ray's operators, and statements left out; less what decides nothing."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

Place = tuple[int, int]  # line from 1 on, column from 0 on

# Operators that are left out, by cosmic-ray's names, and why.
EXCLUDED = re.compile(
    "|".join(
        (
            # A float has no bits to shift: TypeError, so that whatever comes by kills it and flatters us.
            # Powers, remainders and floors in place of + - * / are seen by whatever sees those.
            r"core/ReplaceBinaryOperator_\w+_(RShift|LShift|BitOr|BitAnd|BitXor|Pow|Mod|FloorDiv)$",
            r"core/ReplaceUnaryOperator_\w+_(Invert|Not)$",
            # Identity in place of equality: CPython alone decides whether small integers differ.
            r"core/ReplaceComparisonOperator_(Eq|NotEq|Lt|LtE|Gt|GtE)_(Is|IsNot)$",
            r"core/ReplaceComparisonOperator_(Is|IsNot)_(Eq|NotEq|Lt|LtE|Gt|GtE)$",
            # Codes, flags and exact zeros have no order; their negation is kept.
            r"core/ReplaceComparisonOperator_(Eq|NotEq)_(Lt|LtE|Gt|GtE)$",
            # Of an order, its boundary and its turning round are kept.
            r"core/ReplaceComparisonOperator_(Lt|LtE|Gt|GtE)_(Eq|NotEq)$",
        )
    )
)


class Mutant(NamedTuple):
    """A module's source with one change in it."""

    line: int
    change: str  # for people
    source: str


def mutants_of(source: str, placeholders: Collection[str] = ()) -> Iterator[Mutant]:
    """Yield each mutant of a source once, in the order of their lines.

    ``placeholders``: constants of the module that stand where nothing is read; their values decide nothing.
    """
    seen, found = {source}, []
    spans = [*_undecided(source), *_constants(source, placeholders)]
    for line, mutated in [*_operators_changed(source, spans), *_statements_left_out(source)]:
        if mutated not in seen:
            seen.add(mutated)
            found.append(Mutant(line, _change(source, mutated), mutated))
    yield from sorted(found)


def _operators_changed(
    source: str, spans: Iterable[tuple[Place, Place]]
) -> Iterator[tuple[int, str]]:
    tree = get_ast(source)
    for name in operator_names():
        operator_class = get_operator(name)
        if operator_class.arguments() or EXCLUDED.match(name):
            continue
        operator = operator_class()
        places = [at for node in ast_nodes(tree) for at in operator.mutation_positions(node)]
        for occurrence, (start, _) in enumerate(places):
            if not any(first <= start < last for first, last in spans):
                yield start[0], mutate_code(source, operator, occurrence)


def _undecided(source: str) -> Iterator[tuple[Place, Place]]:
    """Yield the pieces of a source that decide nothing.

    Annotations, which nobody evaluates; the marks of abstract methods; protocols; fields of named tuples,
    whose defaults serve tests and people alone: a run gives every value from the declarations.
    """
    for node in ast.walk(ast.parse(source)):
        pieces: list[ast.expr | ast.stmt | None] = []
        if isinstance(node, ast.ClassDef):
            bases = [base.id for base in node.bases if isinstance(base, ast.Name)]
            if "Protocol" in bases:
                pieces.append(node)
            elif "NamedTuple" in bases:
                pieces += [item for item in node.body if isinstance(item, ast.AnnAssign)]
        elif isinstance(node, ast.FunctionDef):
            pieces.append(node.returns)
            marks = [one for one in node.decorator_list if ast.unparse(one) == "abstractmethod"]
            yield from map(_mark, marks)
        elif isinstance(node, (ast.arg, ast.AnnAssign)):
            pieces.append(node.annotation)
        yield from (_place(piece) for piece in pieces if piece is not None)


def _constants(source: str, names: Collection[str]) -> Iterator[tuple[Place, Place]]:
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and {ast.unparse(one) for one in node.targets} <= {*names}:
            yield _place(node)


def _place(node: ast.expr | ast.stmt) -> tuple[Place, Place]:
    end = node.end_lineno or node.lineno, node.end_col_offset or node.col_offset
    return (node.lineno, node.col_offset), end


def _mark(decorator: ast.expr) -> tuple[Place, Place]:
    (line, column), end = _place(decorator)
    return (line, column - 1), end  # from its @ on


def _statements_left_out(source: str) -> Iterator[tuple[int, str]]:
    """Yield the source without a call, an assignment to an attribute or an augmented one.

    Without an assignment to a name, what follows would not run.
    """
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        left_out = (
            (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call))
            or isinstance(node, ast.AugAssign)
            or (
                isinstance(node, ast.Assign)
                and all(isinstance(target, ast.Attribute) for target in node.targets)
            )
        )
        if left_out and isinstance(node, ast.stmt):
            (first, column), (last, end) = _place(node)
            instead = lines[first - 1][:column] + "pass" + lines[last - 1][end:]
            yield first, "".join([*lines[: first - 1], instead, *lines[last:]])


def _change(before: str, after: str) -> str:
    """Return the changed lines as ``old  ->  new``."""
    old, new = before.splitlines(), after.splitlines()
    while old and new and old[0] == new[0]:
        del old[0], new[0]
    while old and new and old[-1] == new[-1]:
        del old[-1], new[-1]
    return "  ->  ".join(" ".join(line.strip() for line in lines) for lines in (old, new))
