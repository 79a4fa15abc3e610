"""Functions of Python as C99, specialised by the types of their arguments: statements, expressions, calls.

A value of the subset is a C expression without side effects; what needs a place, such as a record whose
fields are read, gets a variable. Records and tuples are structs: arguments go by `const` pointer, results by
value.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType, ModuleType
from typing import Any, TypeVar

import numpy as np

from .program import Definitions, Translated
from .types import (
    BOOLEAN,
    INTEGER,
    NOTHING,
    NUMBERS,
    REAL,
    Array,
    RecordType,
    Scalar,
    Static,
    TableType,
    Type,
    UntranslatableError,
    Value,
    at_run_time,
    shown,
)

Node = TypeVar("Node", bound=ast.AST)
T = TypeVar("T")
Binary = Callable[[Any, Any], Any]
# What is outside the subset: the problem, and what to write instead.
_OUTSIDE: dict[tuple[type[ast.AST], ...], tuple[str, str]] = {
    (ast.List,): ("lists are not translated", "use a tuple of fixed length"),
    (ast.Dict,): ("dictionaries are not translated", "use a named tuple"),
    (ast.Set,): ("sets are not translated", "use comparisons"),
    (ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp): (
        "comprehensions are not translated",
        "write the elements, or a for loop",
    ),
    (ast.Lambda,): ("lambda is not translated", "use def at the module's level"),
    (ast.NamedExpr,): ("an assignment in an expression", "assign on a line of its own"),
    (ast.JoinedStr,): ("strings are not translated", "compute with numbers"),
    (ast.Await,): ("await is not translated", "compute from the arguments alone"),
    (ast.Yield, ast.YieldFrom): ("generators are not translated", "return a tuple"),
    (ast.Starred,): ("a star outside of a tuple", "name each element"),
    (ast.Try,): ("exceptions are not translated", "test with if what would raise"),
    (ast.Raise,): ("exceptions are not translated", "hold the last command instead"),
    (ast.Assert,): ("an assertion raises", "leave it out"),
    (ast.With,): ("with is not translated", "compute from the arguments alone"),
    (ast.FunctionDef,): ("a function in a function", "move it to the module's level"),
    (ast.ClassDef,): ("a class in a function", "move it to the module's level"),
    (ast.Global, ast.Nonlocal): ("it changes what is outside", "keep it in the memory"),
    (ast.Import, ast.ImportFrom): ("it imports while it runs", "import at the top of the module"),
    (ast.Delete,): ("del is not translated", "leave it out"),
    (ast.Match,): ("match is not translated", "use if and elif"),
    (ast.expr,): ("this expression is not translated", "use numbers and named tuples"),
    (ast.stmt,): ("this statement is not translated", "use assignments, if, for and while"),
}
# Of built-in functions.
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
_TO_INTEGER = {
    int: "truncated",
    math.trunc: "truncated",
    math.floor: "floor_of",
    math.ceil: "ceiling_of",
}
_ARITHMETIC: dict[type[ast.operator], tuple[str, Binary]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
}
_OF_INTEGERS: dict[type[ast.operator], tuple[str, Binary]] = {
    ast.FloorDiv: ("floor_div", operator.floordiv),
    ast.Mod: ("floor_mod", operator.mod),
    ast.BitAnd: ("&", operator.and_),
    ast.BitOr: ("|", operator.or_),
    ast.BitXor: ("^", operator.xor),
    ast.LShift: ("<<", operator.lshift),
    ast.RShift: (">>", operator.rshift),
}
_SIGNS: dict[type[ast.unaryop], tuple[str, Callable[[Any], Any]]] = {
    ast.USub: ("-", operator.neg),
    ast.UAdd: ("+", operator.pos),
    ast.Invert: ("~", operator.invert),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, Binary]] = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}
_WIDEST = 2**63
_WORD = re.compile(r"(?<![\w.>])[A-Za-z_]\w*")  # no field of a record
_PLACE = re.compile(r"\(\*\w+\)|\w+(->\w+)?[\w.\[\]]*")
_WIDTH = 110  # of a line of C


class Program(Definitions):
    """Functions of Python as C, with all that they call.

    The contract is in docs/design.md: for arguments with which CPython does not raise, what is translated
    gives CPython's bits; anything else is refused.
    """

    def function(self, python: Callable[..., Any], types: Sequence[Type]) -> Translated:
        """Return a function translated for arguments of these types.

        Raises UntranslatableError.
        """
        if not isinstance(python, FunctionType):
            raise UntranslatableError(repr(python), 0, "", "it is not a plain function", "use def")
        key = (python, tuple(types))
        if key in self.busy:
            place = (_qualified(python), python.__code__.co_firstlineno, python.__name__)
            raise UntranslatableError(*place, "it calls itself", "write a loop")
        if key not in self.functions:
            self.busy.append(key)
            try:
                self.functions[key] = _Function(self, python, types).translated()
            finally:
                self.busy.pop()
        return self.functions[key]


@dataclass
class _Local:
    """A local name of Python: how it is read, and the block where it got its type."""

    value: Value
    block: list[str]


class _Function:
    """One function while it is translated."""

    def __init__(self, program: Program, python: FunctionType, types: Sequence[Type]) -> None:
        self.program, self.python, self.types = program, python, types
        self.line = python.__code__.co_firstlineno
        self.tree = self._source()
        self.node: ast.AST = self.tree
        names = [node for node in ast.walk(self.tree) if isinstance(node, ast.Name)]
        self.stores = Counter(node.id for node in names if isinstance(node.ctx, ast.Store))
        self.loads = {node.id for node in names if isinstance(node.ctx, ast.Load)}
        cells = [cell.cell_contents for cell in python.__closure__ or ()]
        self.free = dict(zip(python.__code__.co_freevars, cells, strict=True))
        self.variables: dict[str, _Local] = {}
        self.taken: set[str] = set()  # C names of variables
        self.declared: list[tuple[str, Type]] = []  # variables that are declared at the top
        self.fixed: set[str] = set()  # C names whose values never change
        self.root: list[str] = []
        self.lines = self.root  # of the block that is being written
        self.loops = 0
        self.result: Type | None = None
        self.writes = False

    def _source(self) -> ast.FunctionDef:
        try:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(self.python))).body
            if isinstance(tree, ast.FunctionDef):
                return tree
        except (OSError, SyntaxError, TypeError):
            pass
        place = (_qualified(self.python), self.line, self.python.__name__)
        raise UntranslatableError(*place, "it has no source of its own", "use def")

    def translated(self) -> Translated:
        """Translate the function. Raises UntranslatableError."""
        a, program = self.tree.args, self.program
        if a.vararg or a.kwarg:
            raise self.refused("it takes any number of arguments", "name each of them", a)
        for decorator in self.tree.decorator_list:
            raise self.refused("it is decorated", "leave the decorator out", decorator)
        takes = []
        for argument, t in zip([*a.posonlyargs, *a.args, *a.kwonlyargs], self.types, strict=True):
            name, value = argument.arg, Value(t)
            if at_run_time(t):
                c = self.local(name)
                record = isinstance(t, RecordType)
                takes.append(
                    f"const {program.declared(t, f'*{c}')}" if record else program.declared(t, c)
                )
                value = Value(t, f"(*{c})" if record else c)
                if not self.stores[name]:
                    self.fixed.add(c)
                elif record:  # the argument itself stays as it is
                    value = Value(t, self.new(value, name))
            self.variables[name] = _Local(value, self.root)
        if not self.statements(self.tree.body):
            self._return(Value(NOTHING))
        module, t = self.python.__module__, self.result or NOTHING
        name = program.name(f"{module.rsplit('.', 1)[-1]}_{self.python.__name__}")
        gives = program.declared(t, name) if at_run_time(t) else f"void {name}"
        source = f"{module}.{self.python.__qualname__}".replace(".<locals>", "")
        comment = f"/* {source}: {_first_line(self.tree)} */"
        head = f"static {gives}({', '.join(takes) or 'void'}) {{"
        words = set(_WORD.findall("\n".join(self.root)))
        declared = [*self.declared, ("result", t)]
        variables = [f"{program.declared(t, c)};" for c, t in declared if c in words]
        lines = [head, *indented([*variables, *self.root]), "}"]
        text = "\n".join([comment, *(part for line in lines for part in _parts_of(line))])
        return Translated(self.python, name, t, self.writes, text)

    # What is refused -----------------------------------------------------------------------------------

    def at(self, node: Node, translate: Callable[[Node], T]) -> T:
        """Translate a node; until it is done, `refused` is about that node."""
        before, self.node = self.node, node
        result = translate(node)
        self.node = before
        return result

    def refused(
        self, problem: str, remedy: str, node: ast.AST | None = None
    ) -> UntranslatableError:
        """Return the error for a construct, by default the one that is being translated."""
        node = node or self.node
        line = self.line + getattr(node, "lineno", 1) - 1
        text = " ".join(ast.unparse(node).split())
        text = text if len(text) <= 80 else f"{text[:77]}..."
        return UntranslatableError(_qualified(self.python), line, text, problem, remedy)

    def outside(self, node: ast.AST) -> UntranslatableError:
        """Return the error for a kind of expression or statement that is never translated."""
        problem, remedy = next(v for k, v in _OUTSIDE.items() if isinstance(node, k))
        return self.refused(problem, remedy, node)

    # Lines and variables of C --------------------------------------------------------------------------

    @contextmanager
    def block(self, loop: bool = False) -> Iterator[list[str]]:
        """Collect the lines that follow in a list of their own."""
        before, self.lines = self.lines, []
        self.loops += loop
        try:
            yield self.lines
        finally:
            self.lines = before
            self.loops -= loop

    def put(self, head: str, lines: Sequence[str]) -> None:
        """Append lines in braces."""
        self.lines += [f"{head} {{".lstrip(), *indented(lines), "}"]

    def local(self, name: str) -> str:
        """Return a C name for a variable, its own in this function."""
        plain, count = self.program.local(name), 1
        c = plain
        while c in self.taken:
            count += 1
            c = self.program.local(f"{plain}_{count}")
        self.taken.add(c)
        return c

    def new(self, value: Value, hint: str) -> str:
        """Return a new variable of the block with a value."""
        c = self.local(hint)
        self.lines.append(f"{self.program.declared(value.type, c)} = {self.initial(value)};")
        if self.lines is self.root:
            self.fixed.add(c)
        return c

    def store(self, place: str, value: Value) -> None:
        """Append the assignment of a value to a variable."""
        if not isinstance(value.type, RecordType) or not self.reads(value, {place}):
            self._fill(place, value)
            return
        with self.block() as lines:
            self._fill(place, Value(value.type, self.new(value, "next")))
        self.put("", lines)

    def _fill(self, place: str, value: Value) -> None:
        if value.parts is None:
            self.lines.append(f"{place} = {bare(value.code)};")
            return
        assert isinstance(value.type, RecordType)
        for i, part in enumerate(value.parts):
            if at_run_time(part.type):
                self._fill(f"{place}.{self.program.field(value.type, i)}", part)

    def initial(self, value: Value) -> str:
        """Return a variable's initializer: the text behind the sign of equality where it is declared."""
        if value.parts is None:
            return bare(value.code)
        inside = ", ".join(self.initial(p) for p in value.parts if at_run_time(p.type))
        row = isinstance(value.type, RecordType) and value.type.row
        return f"{{{{{inside}}}}}" if row else f"{{{inside}}}"

    def in_memory(self, value: Value, hint: str) -> Value:
        """Return a value whose code may be used more than once."""
        place = value.parts is None and _PLACE.fullmatch(value.code)
        if place or value.known is not None or not at_run_time(value.type):
            return value
        return Value(value.type, self.new(value, hint))

    def fields(self, value: Value) -> list[Value]:
        """Return the elements of a tuple or a table."""
        t = value.type
        if value.parts is not None:
            return list(value.parts)
        if isinstance(t, TableType):
            return [Value(t.element, f"{value.code}[{i}]") for i in range(t.length)]
        assert isinstance(t, RecordType)
        owner = dotted(self.in_memory(value, "whole").code)
        return [
            Value(inner, f"{owner}{self.program.field(t, i)}" if at_run_time(inner) else "")
            for i, inner in enumerate(t.types)
        ]

    @staticmethod
    def made(kind: type[Any] | None, parts: Sequence[Value]) -> Value:
        """Return a tuple of values."""
        return Value(RecordType(kind, tuple(part.type for part in parts)), parts=tuple(parts))

    def number(self, number: int, name: str = "") -> Value:
        """Return an int or a bool that is known."""
        if not -_WIDEST <= number < _WIDEST:
            raise self.refused(f"{number} has more than 64 bits", "use smaller numbers")
        return self.program.known(number, name)

    def converted(self, value: Value, to: Type) -> Value:
        """Return a number as another type, as arithmetic does it."""
        t = value.type
        if t == to:
            return value
        if to == REAL and t == INTEGER:
            if value.known is not None and abs(value.known) <= 2**53:
                return Value(REAL, self.program.literal(float(value.known)))
            return Value(REAL, f"(double){value.code}")
        raise self.refused(f"{shown(t)} where {shown(to)} is needed", f"give {shown(to)}")

    # Statements: True if control does not go on behind them ---------------------------------------------

    def statements(self, body: Sequence[ast.stmt]) -> bool:
        """Translate statements until one of them always leaves."""
        return any(self.at(node, self._statement) for node in body)

    def _statement(self, node: ast.stmt) -> bool:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass() | ast.AnnAssign(value=None):
                return False
            case ast.Expr(value=ast.Call() as call):
                self.alone(call)
            case ast.Return():
                return self._return(
                    Value(NOTHING) if node.value is None else self.alone(node.value)
                )
            case ast.AnnAssign(value=ast.expr() as value_node):
                self._assign([node.target], value_node)
            case ast.Assign():
                self._assign(node.targets, node.value)
            case ast.AugAssign():
                load = ast.parse(ast.unparse(node.target), mode="eval").body
                for part in ast.walk(load):
                    ast.copy_location(part, node.target)
                both = ast.copy_location(ast.BinOp(load, node.op, node.value), node)
                self._assign([node.target], both)
            case ast.If():
                return self._if(node)
            case ast.While():
                self._while(node)
            case ast.For():
                return self._for(node)
            case ast.Break() | ast.Continue():
                if self.loops == 0:
                    raise self.refused("it leaves a loop that is unrolled", "loop over a range")
                self.lines.append("break;" if isinstance(node, ast.Break) else "continue;")
                return True
            case _:
                raise self.outside(node)
        return False

    def _return(self, value: Value) -> bool:
        t = value.type
        if isinstance(t, Static):
            problem = "it returns a function or a class"
            raise self.refused(problem, "return numbers and named tuples")
        if self.result not in (None, t):
            problem = f"it returns {shown(t)}, elsewhere {shown(self.result or NOTHING)}"
            raise self.refused(problem, "return one type everywhere: 0.0 for 0")
        self.result = t
        if value.parts is not None and at_run_time(t):
            self.store("result", value)
            value = Value(t, "result")
        self.lines.append(f"return {bare(value.code)};" if at_run_time(t) else "return;")
        return True

    def _if(self, node: ast.If) -> bool:
        test = self.truth(node.test)
        if test.known is not None:
            return self.statements(node.body if test.known else node.orelse)
        with self.block() as lines:
            leaves = self.statements(node.body)
        self.put(f"if ({bare(test.code)})", lines)
        with self.block() as other:
            leaves = self.statements(node.orelse) and leaves
        if other and other[0].startswith("if (") and all(line[0] in " }" for line in other[1:]):
            self.lines[-1] = f"}} else {other[0]}"
            self.lines += other[1:]
        elif other:
            self.lines[-1] = "} else {"
            self.lines += [*indented(other), "}"]
        return leaves

    def _while(self, node: ast.While) -> None:
        if node.orelse:
            raise self.refused("a loop has an else", "set a bool in the loop", node.test)
        with self.block(loop=True) as lines:
            test = self.truth(node.test)
            if test.known is not None and not test.known:
                return
            head = f"while ({bare(test.code)})"
            if lines:  # the test needs statements of its own
                head = "while (true)"
                self.put(f"if (!{test.code})", ["break;"])
            self.statements(node.body)
        self.put(head, lines)

    def _for(self, node: ast.For) -> bool:
        if node.orelse:
            raise self.refused("a loop has an else", "set a bool in the loop", node.target)
        call = node.iter
        if isinstance(call, ast.Call) and self.expression(call.func).type == Static(range):
            self._over_range(node, call)
            return False
        values = self.expression(node.iter)
        t = values.type
        if isinstance(t, RecordType) and t.kind is None:
            return self._over_tuple(node, self.fields(values))
        if isinstance(t, Array) and t.dimensions == 1:
            self._over_elements(node, t.element, f"{values.code}.data", f"{values.code}.length")
        elif isinstance(t, TableType):
            self._over_elements(node, t.element, values.code, str(t.length))
        else:
            problem = f"a loop over {shown(t)}"
            raise self.refused(problem, "loop over a range, or over a tuple", node.iter)
        return False

    def _over_range(self, node: ast.For, call: ast.Call) -> None:
        arguments = [self.expression(argument) for argument in call.args]
        if not 1 <= len(arguments) <= 3 or any(a.type != INTEGER for a in arguments):
            raise self.refused("a range of what are not integers", "give ints", call)
        first = arguments[0] if len(arguments) > 1 else self.number(0)
        stop = arguments[min(len(arguments) - 1, 1)]
        step = arguments[2].known if len(arguments) == 3 else 1
        if not step:
            raise self.refused("a step that is not known", "give a literal step", call)
        both = first.known is not None and stop.known is not None
        if both and not range(int(first.known or 0), int(stop.known or 0), step):
            return
        end = stop.code if stop.known is not None else self.new(stop, "stop")
        i = self.local("index")
        change = f"{i}++" if step == 1 else f"{i}--" if step == -1 else f"{i} += {step}"
        head = f"int64_t {i} = {bare(first.code)}; {i} {'<' if step > 0 else '>'} {end}; {change}"
        self._repeat(node, head, Value(INTEGER, i))

    def _over_elements(self, node: ast.For, element: Scalar, data: str, length: str) -> None:
        i = self.local("index")
        head = f"int64_t {i} = 0; {i} < {length}; {i}++"
        self._repeat(node, head, Value(element, f"{data}[{i}]"))

    def _repeat(self, node: ast.For, head: str, item: Value) -> None:
        with self.block(loop=True) as lines:
            self.assign(node.target, item)
            self.statements(node.body)
        self.put(f"for ({head})", lines)

    def _over_tuple(self, node: ast.For, items: list[Value]) -> bool:
        """Translate a loop over a tuple: in a loop over its known numbers, or element by element."""
        if items and all(item.known is not None and item.type == INTEGER for item in items):
            table = TableType(INTEGER, len(items))
            c = self.program.table([item.known for item in items], table, "items")
            self._over_elements(node, INTEGER, c, str(len(items)))
            return False
        names = [n for n in ast.walk(node) if isinstance(n, ast.Name)]
        self.stores.update(n.id for n in names if isinstance(n.ctx, ast.Store))  # for each item
        held = [self.in_memory(item, "item") if item.parts is None else item for item in items]
        loops, self.loops = self.loops, 0
        try:
            for item in held:
                self.assign(node.target, item)
                if self.statements(node.body):
                    return True
        finally:
            self.loops = loops
        return False

    # Assignments ---------------------------------------------------------------------------------------

    def _assign(self, targets: Sequence[ast.expr], node: ast.expr) -> None:
        value = self.alone(node)
        if len(targets) > 1:
            value = self.in_memory(value, "value")
        for target in targets:
            self.assign(target, value)

    def _unpack(self, target: ast.Tuple | ast.List, items: list[Value]) -> None:
        if len(items) != len(target.elts) or ast.Starred in map(type, target.elts):
            raise self.refused("it unpacks no tuple of this length", "name each element", target)
        names = {n.id for n in ast.walk(target) if isinstance(n, ast.Name)}
        changed = {self.variables[n].value.code for n in names if n in self.variables}
        writes = any(isinstance(t, ast.Subscript) for t in target.elts)
        for i, item in enumerate(items[1:], 1):  # all are read before the first is set
            stays = item.known is not None or not at_run_time(item.type)
            if not stays and (writes or self.reads(item, changed)):
                items[i] = Value(item.type, self.new(item, "value"))
        for single, item in zip(target.elts, items, strict=True):
            self.assign(single, item)

    def reads(self, value: Value, names: set[str]) -> bool:
        """Return True if a value's code reads one of the variables."""
        if value.parts is not None:
            return any(self.reads(part, names) for part in value.parts)
        return not names.isdisjoint(_WORD.findall(value.code))

    def assign(self, target: ast.expr, value: Value) -> None:
        """Assign a value to a target of Python."""
        self.at(target, lambda node: self._assign_to(node, value))

    def _assign_to(self, target: ast.expr, value: Value) -> None:
        match target:
            case ast.Name(id=name):
                self._assign_name(name, value)
            case ast.Tuple() | ast.List():
                tuples = RecordType | TableType
                self._unpack(target, self.fields(value) if isinstance(value.type, tuples) else [])
            case ast.Subscript():
                array = self.expression(target.value)
                if not isinstance(array.type, Array):
                    raise self.refused("it changes items of a non-array", "make a new tuple")
                self.writes = True
                place = self.element(array, target.slice).code
                item = self.converted(value, array.type.element)
                self.lines.append(f"{place} = {bare(item.code)};")
            case _:
                raise self.refused("it changes an attribute", "use _replace, or a new named tuple")

    def _assign_name(self, name: str, value: Value) -> None:
        if name not in self.loads:
            return
        t, variable = value.type, self.variables.get(name)
        if variable is not None and variable.value.type != t:
            before = variable.value.type
            if at_run_time(before):
                problem = f"it was {shown(before)}, and becomes {shown(t)}"
                raise self.refused(problem, "keep one type in a variable: 0.0 for 0, another name")
            if variable.block is not self.lines:
                raise self.refused(f"it may be {shown(before)}, too", "use another name")
            variable = None
        if variable is None:
            once = self.stores[name] == 1
            if not at_run_time(t) or (once and self._stays(value)):
                self.variables[name] = _Local(value, self.lines)
                return
            c = self.local(name)
            self.variables[name] = variable = _Local(Value(t, c), self.lines)
            if once and not self.loops:
                self.fixed.add(c)
            if once and self.lines is self.root:
                self.lines.append(f"{self.program.declared(t, c)} = {self.initial(value)};")
                return
            self.declared.append((c, t))
        if at_run_time(t) and value.code != variable.value.code:
            self.store(variable.value.code, value)

    def _stays(self, value: Value) -> bool:
        """Return True for a value that needs no variable: known, or a part of what never changes."""
        if value.known is not None:
            return True
        if isinstance(value.type, Scalar) or not _PLACE.fullmatch(value.code):
            return False
        return _WORD.findall(value.code)[0] in self.fixed

    # Expressions ---------------------------------------------------------------------------------------

    def expression(self, node: ast.expr) -> Value:
        """Return an expression's value; lines that it needs are appended to the block."""
        handler = getattr(self, f"_x_{type(node).__name__.lower()}", None)
        if handler is None:
            raise self.outside(node)
        value: Value = self.at(node, handler)
        return value

    def alone(self, node: ast.expr) -> Value:
        """Return the value of an expression that is all of a statement, or of its right side."""
        if not isinstance(node, ast.Call):
            return self.expression(node)
        return self.at(node, lambda call: self._x_call(call, alone=True))

    def _x_constant(self, node: ast.Constant) -> Value:
        value = node.value
        return self.number(value) if isinstance(value, int) else self.program.value(value)

    def _x_name(self, node: ast.Name) -> Value:
        if node.id in self.variables:
            return self.variables[node.id].value
        if self.stores[node.id] > 0:
            raise self.refused("it has no value yet", "assign it before")
        module = self.python.__module__.rsplit(".", 1)[-1]
        for names in (self.free, self.python.__globals__, vars(builtins)):
            if node.id in names:
                return self._outer(node, names[node.id], f"{module}_{node.id.strip('_')}")
        raise self.refused("this name is not known", "define it at the module's level")

    def _outer(self, node: ast.expr, value: Any, name: str) -> Value:
        if isinstance(value, int) and not isinstance(value, bool):
            return self.number(value, ast.unparse(node))
        if isinstance(value, list | dict | set | bytearray | np.ndarray):
            raise self.refused("it may change", "use a tuple")
        return self.program.value(value, name)

    def _x_attribute(self, node: ast.Attribute) -> Value:
        owner = self.expression(node.value)
        t = owner.type
        if isinstance(t, Static):
            if not hasattr(t.value, node.attr):
                raise self.refused("there is no such attribute", "see its definition")
            value = getattr(t.value, node.attr)
            if isinstance(t.value, ModuleType | type) or not isinstance(value, int | float):
                return self._outer(node, value, node.attr)
            raise self.refused("a number outside may change", "use a constant of the module")
        if isinstance(t, RecordType) and t.kind is not None and node.attr in t.names:
            return self.fields(owner)[t.names.index(node.attr)]
        if t == NOTHING:
            raise self.refused("None has no attributes", "test with is None before")
        raise self.refused(f"an attribute of {shown(t)}", "use a named tuple's field")

    def _x_tuple(self, node: ast.Tuple) -> Value:
        parts: list[Value] = []
        for element in node.elts:
            if not isinstance(element, ast.Starred):
                parts.append(self.expression(element))
                continue
            value = self.expression(element.value)
            if not isinstance(value.type, RecordType | TableType):
                problem = f"a star before {shown(value.type)}"
                raise self.refused(problem, "name each element", element)
            parts += self.fields(value)
        return self.made(None, parts)

    def _x_subscript(self, node: ast.Subscript) -> Value:
        value = self.expression(node.value)
        t = value.type
        if not isinstance(node.slice, ast.Slice):
            return self.element(value, node.slice)
        if not isinstance(t, RecordType | TableType):
            raise self.refused(f"a slice of {shown(t)}", "use single elements")
        bounds = (node.slice.lower, node.slice.upper, node.slice.step)
        try:
            cut = slice(*(None if b is None else ast.literal_eval(b) for b in bounds))
        except ValueError:
            raise self.refused("a slice that is not known", "give literal bounds") from None
        return self.made(None, self.fields(value)[cut])

    def element(self, value: Value, place: ast.expr) -> Value:
        """Return an element of a tuple, a table or an array."""
        t = value.type
        if isinstance(t, Array):
            return self._of_array(value, t, place)
        if not isinstance(t, RecordType | TableType):
            raise self.refused(f"an element of {shown(t)}", "use a tuple")
        index = self.expression(place)
        length = t.length if isinstance(t, TableType) else len(t.types)
        if isinstance(t, TableType) and length == 0:  # never reached: Python would raise
            return Value(t.element, self.program.literal(0.0 if t.element == REAL else 0))
        if index.known is not None:
            if not -length <= index.known < length:
                raise self.refused(f"it has {length} elements", "use an index within them")
            return self.fields(value)[index.known]
        if isinstance(t, TableType):
            return Value(t.element, f"{value.code}[{self._index(index, length)}]")
        if not t.row:
            raise self.refused("an index not known, of different types", "use a literal index")
        owner = dotted(self.in_memory(value, "row").code)
        return Value(t.types[0], f"{owner}v[{self._index(index, length)}]")

    def _of_array(self, value: Value, t: Array, place: ast.expr) -> Value:
        indices = place.elts if isinstance(place, ast.Tuple) else [place]
        if len(indices) != t.dimensions:
            raise self.refused(f"an array of {t.dimensions} dimensions", "give an index for each")
        lengths = ("rows", "columns") if t.dimensions == 2 else ("length",)
        codes = [
            self._index(self.expression(index), f"{value.code}.{length}")
            for index, length in zip(indices, lengths, strict=True)
        ]
        code = f"{codes[0]} * {value.code}.columns + {codes[1]}" if codes[1:] else codes[0]
        return Value(t.element, f"{value.code}.data[{code}]")

    def _index(self, index: Value, length: int | str) -> str:
        """Return the code of an index, counted from the beginning."""
        if index.type != INTEGER:
            raise self.refused(f"an index of {shown(index.type)}", "use an int")
        if index.known is not None and index.known >= 0:
            return index.code
        return f"index_in({bare(index.code)}, {length})"

    # Conditions ----------------------------------------------------------------------------------------

    def truth(self, node: ast.expr) -> Value:
        """Return an expression as a condition."""
        return self.at(node, lambda inner: self.condition(self.expression(inner)))

    def condition(self, value: Value) -> Value:
        """Return a value as a condition; known where its type decides."""
        t = value.type
        if value.known is not None:
            return self.number(bool(value.known))
        if t == BOOLEAN:
            return value
        if t == NOTHING:
            return self.number(False)
        if t in NUMBERS:
            return Value(BOOLEAN, f"({value.code} != {'0' if t == INTEGER else '0.0'})")
        if isinstance(t, TableType) or (isinstance(t, RecordType) and t.kind is None):
            return self.number(bool(t.length if isinstance(t, TableType) else t.types))
        remedy = "compare with is None, or len() with 0"
        raise self.refused(f"{shown(t)} as a condition", remedy)

    def _x_boolop(self, node: ast.BoolOp) -> Value:
        conjunction = isinstance(node.op, ast.And)
        sign = " && " if conjunction else " || "
        terms: list[str] = []
        for operand in node.values:
            with self.block() as lines:
                value = self.expression(operand)
            if value.type == NOTHING:
                value = self.number(False)
            if value.type != BOOLEAN:
                problem = f"and, or of {shown(value.type)}"
                raise self.refused(problem, "compare it with something", operand)
            if value.known is not None:
                if bool(value.known) != conjunction:  # it decides, whatever the others are
                    return self.number(not conjunction)
            elif lines and terms:  # evaluated only if the ones before do not decide
                c = self.new(Value(BOOLEAN, sign.join(terms)), "both" if conjunction else "either")
                lines.append(f"{c} = {bare(value.code)};")
                self.put(f"if ({c if conjunction else f'!{c}'})", lines)
                terms = [c]
            else:
                self.lines += lines
                terms.append(value.code)
        if not terms:
            return self.number(conjunction)
        return Value(BOOLEAN, terms[0] if len(terms) == 1 else f"({sign.join(terms)})")

    def _x_compare(self, node: ast.Compare) -> Value:
        operands = [self.expression(n) for n in (node.left, *node.comparators)]
        terms = []
        for a, b, op in zip(operands, operands[1:], node.ops, strict=False):
            term = self._comparison(a, b, op)
            if term.known is False:
                return term
            if term.known is None:
                terms.append(term.code)
        if not terms:
            return self.number(True)
        code = terms[0] if len(terms) == 1 else f"({' && '.join(terms)})"
        return Value(BOOLEAN, code)

    def _comparison(self, a: Value, b: Value, op: ast.cmpop) -> Value:
        if isinstance(op, ast.Is | ast.IsNot):
            if NOTHING not in (a.type, b.type):
                raise self.refused("is of what is not None", "compare with ==")
            return self.number((a.type == b.type) == isinstance(op, ast.Is))
        if isinstance(op, ast.In | ast.NotIn):
            raise self.refused("in is not translated", "compare with == and or")
        sign, compute = _COMPARISONS[type(op)]
        if a.known is not None and b.known is not None:
            return self.number(bool(compute(a.known, b.known)))
        equality = isinstance(op, ast.Eq | ast.NotEq)
        if isinstance(a.type, RecordType) and equality:
            if a.type != b.type:
                problem = f"{shown(a.type)} compared with {shown(b.type)}"
                raise self.refused(problem, "compare the elements")
            pairs = zip(self.fields(a), self.fields(b), strict=True)
            terms = [self._comparison(x, y, ast.Eq()).code for x, y in pairs]
            code = f"({' && '.join(terms) or 'true'})"
            return Value(BOOLEAN, code if sign == "==" else f"(!{code})")
        if not (a.type == b.type == BOOLEAN and equality):
            if a.type not in NUMBERS or b.type not in NUMBERS:
                problem = f"{shown(a.type)} compared with {shown(b.type)}"
                raise self.refused(problem, "compare numbers")
            if a.type != b.type:
                whole = a if a.type == INTEGER else b
                if whole.known is None or abs(whole.known) > 2**53:
                    problem = "an int compared with a float"
                    raise self.refused(problem, "compare float(...) of it")
                a, b = self.converted(a, REAL), self.converted(b, REAL)
        return Value(BOOLEAN, f"({a.code} {sign} {b.code})")

    def _x_ifexp(self, node: ast.IfExp) -> Value:
        test = self.truth(node.test)
        if test.known is not None:
            return self.expression(node.body if test.known else node.orelse)
        with self.block() as then:
            a = self.expression(node.body)
        with self.block() as other:
            b = self.expression(node.orelse)
        t = a.type
        if t != b.type or isinstance(t, Static | Array | TableType):
            problem = f"it is {shown(t)} or {shown(b.type)}"
            raise self.refused(problem, "give both the same type: 0.0 for 0")
        if not at_run_time(t):
            return a
        if not (then or other or a.parts or b.parts):
            return Value(t, f"({test.code} ? {a.code} : {b.code})")
        c = self.local("either")
        self.declared.append((c, t))
        for head, lines, value in (
            (f"if ({bare(test.code)})", then, a),
            ("else", other, b),
        ):
            with self.block() as more:
                self.store(c, value)
            self.put(head, [*lines, *more])
        return Value(t, c)

    # Arithmetic ----------------------------------------------------------------------------------------

    def _x_unaryop(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            test = self.truth(node.operand)
            known = test.known is not None
            return self.number(not test.known) if known else Value(BOOLEAN, f"!{test.code}")
        value = self.expression(node.operand)
        t, (sign, compute) = value.type, _SIGNS[type(node.op)]
        if t not in NUMBERS or (sign == "~" and t == REAL):
            raise self.refused(f"a sign of {shown(t)}", "compute with numbers")
        if value.known is not None:
            return self.number(compute(value.known))
        return value if sign == "+" else Value(t, f"({sign}{value.code})")

    def _x_binop(self, node: ast.BinOp) -> Value:
        op = type(node.op)
        if op is ast.Pow:
            base = ast.unparse(node.left)
            problem = "CPython's ** calls the C library's pow"
            raise self.refused(problem, f"multiply: {base} * {base}")
        a, b = self.expression(node.left), self.expression(node.right)
        if a.type not in NUMBERS or b.type not in NUMBERS:
            problem = f"{shown(a.type)} and {shown(b.type)}"
            raise self.refused(problem, "compute with numbers")
        reals = REAL in (a.type, b.type)
        if op is ast.Div and not reals:
            return Value(REAL, f"quotient({bare(a.code)}, {bare(b.code)})")
        if op in _ARITHMETIC or op is ast.Div:
            sign, compute = _ARITHMETIC.get(op, ("/", operator.truediv))
            if reals:
                a, b = self.converted(a, REAL), self.converted(b, REAL)
                return Value(REAL, f"({a.code} {sign} {b.code})")
        elif reals:
            raise self.refused("this operator on floats", "use math.floor and multiply")
        elif op not in _OF_INTEGERS:
            raise self.refused("this operator is not translated", "use + - * / // %")
        else:
            sign, compute = _OF_INTEGERS[op]
        if op in (ast.FloorDiv, ast.Mod) and b.known == 0:
            raise self.refused("a division by 0", "divide by what is not 0")
        if op in (ast.LShift, ast.RShift) and not (b.known is not None and 0 <= b.known < 63):
            raise self.refused("a shift by what is not known", "shift by a literal")
        if a.known is not None and b.known is not None:
            return self.number(compute(a.known, b.known))
        if op is ast.LShift:
            return Value(INTEGER, f"({a.code} * {self.program.literal(1 << int(b.known or 0))})")
        if op in (ast.FloorDiv, ast.Mod):
            return Value(INTEGER, f"{sign}({bare(a.code)}, {bare(b.code)})")
        return Value(INTEGER, f"({a.code} {sign} {b.code})")

    # Calls ---------------------------------------------------------------------------------------------

    def _x_call(self, node: ast.Call, alone: bool = False) -> Value:
        """Return the value of a call; ``alone``: it is all of a statement, or of its right side."""
        if ast.Starred in map(type, node.args) or None in [k.arg for k in node.keywords]:
            raise self.refused("a star in a call", "name each argument")
        if isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
            return self._replaced(node, node.func.value)
        function = self.expression(node.func)
        if not isinstance(function.type, Static):
            raise self.refused(f"a call of {shown(function.type)}", "call a function")
        callee = function.type.value
        arguments = [self.expression(a) for a in node.args]
        named = {str(k.arg): self.expression(k.value) for k in node.keywords}
        if isinstance(callee, type) and issubclass(callee, tuple) and hasattr(callee, "_fields"):
            return self.made(callee, self._bound(callee, arguments, named))
        if isinstance(callee, FunctionType):
            return self._function(callee, self._bound(callee, arguments, named), alone)
        if named:
            raise self.refused("named arguments of a built-in function", "leave out the names")
        return self._built_in(node, callee, arguments)

    def _replaced(self, node: ast.Call, owner: ast.expr) -> Value:
        value = self.expression(owner)
        t = value.type
        if not isinstance(t, RecordType) or t.kind is None or node.args:
            raise self.refused("_replace of something other than a named tuple", "make a new tuple")
        parts = dict(zip(t.names, self.fields(value), strict=True))
        for keyword in node.keywords:
            if keyword.arg not in parts:
                raise self.refused(f"there is no field {keyword.arg}", "see the named tuple")
            before, new = parts[keyword.arg].type, self.expression(keyword.value)
            if before != new.type:
                problem = f"{keyword.arg} was {shown(before)}, and becomes {shown(new.type)}"
                raise self.refused(problem, "keep its type: 0.0 for 0")
            parts[keyword.arg] = new
        return self.made(t.kind, list(parts.values()))

    def _bound(self, callee: Any, given: list[Value], named: dict[str, Value]) -> list[Value]:
        """Return the values of a call in the order of what the callee takes, with defaults."""
        parameters = list(inspect.signature(callee).parameters.values())
        values = list(given)
        for parameter in parameters[len(given) :]:
            if parameter.name in named:
                values.append(named.pop(parameter.name))
            elif parameter.default is not inspect.Parameter.empty:
                values.append(self.program.value(parameter.default))
        if named or len(values) != len(parameters):
            takes = f"{callee.__name__} takes {', '.join(p.name for p in parameters)}"
            raise self.refused(takes, "give each of them once")
        return values

    def _function(self, callee: FunctionType, values: list[Value], alone: bool) -> Value:
        f = self.program.function(callee, [value.type for value in values])
        codes = [self._argument(value) for value in values if at_run_time(value.type)]
        value = Value(f.result, f"{f.name}({', '.join(codes)})" if at_run_time(f.result) else "")
        if not f.writes:
            return value
        self.writes = True
        if not alone:
            problem = "it writes into an array"
            raise self.refused(problem, "assign its result on a line of its own")
        if value.code:
            return Value(f.result, self.new(value, callee.__name__))
        self.lines.append(f"{f.name}({', '.join(codes)});")
        return value

    def _argument(self, value: Value) -> str:
        if not isinstance(value.type, RecordType):
            return bare(value.code)
        kind = value.type.kind
        code = self.in_memory(value, kind.__name__.lower() if kind else "items").code
        return code[2:-1] if code.startswith("(*") else f"&{code}"

    def _built_in(self, node: ast.Call, callee: Any, values: list[Value]) -> Value:
        types = [value.type for value in values]
        codes = [bare(value.code) for value in values]
        match callee, types:
            case ((builtins.int | math.floor | math.ceil | math.trunc), [t]) if t == REAL:
                return Value(INTEGER, f"{_TO_INTEGER[callee]}({codes[0]})")
            case builtins.len, [Array(dimensions=d)]:
                return Value(INTEGER, f"{codes[0]}.{'rows' if d == 2 else 'length'}")
            case builtins.len, [RecordType(kind=None) | TableType()]:
                return self.number(len(self.fields(values[0])))
            case ((builtins.min | builtins.max), [_, _, *_]):
                return self._extreme(callee is min, values)
            case ((builtins.abs | math.fabs), [t]) if t == REAL:
                return Value(REAL, f"real_abs({codes[0]})")
            case builtins.abs, [t] if t == INTEGER:
                return Value(INTEGER, f"integer_abs({codes[0]})")
            case builtins.float, [t] if t in NUMBERS:
                return self.converted(values[0], REAL)
            case builtins.float, [Static(value=str())] if isinstance(node.args[0], ast.Constant):
                return self.program.value(float(str(node.args[0].value)))
            case builtins.int, [t] if t == INTEGER:
                return values[0]
            case builtins.bool, [t] if t == BOOLEAN or t in NUMBERS:
                return self.condition(values[0])
            case math.sqrt, [t] if t in NUMBERS:
                return Value(REAL, f"square_root({bare(self.converted(values[0], REAL).code)})")
            case math.copysign, [t, u] if t == u == REAL:
                return Value(REAL, f"with_sign({', '.join(codes)})")
            case math.isfinite, [t] if t == REAL:
                return Value(BOOLEAN, f"is_finite({codes[0]})")
            case ((math.isnan | math.isinf), [t]) if t == REAL:
                c = self.in_memory(values[0], "number").code
                test = f"{c} != {c}" if callee is math.isnan else f"!is_finite({c}) && {c} == {c}"
                return Value(BOOLEAN, f"({test})")
        if callee in vars(math).values():
            raise self.refused("C does not specify its rounding", "use those of trunk_control.api")
        known = callee in _REMEDIES if isinstance(callee, type | type(len)) else False
        default = ("this call is not translated", "call a plain function, or a named tuple")
        raise self.refused(*(_REMEDIES[callee] if known else default))

    def _extreme(self, least: bool, values: list[Value]) -> Value:
        if any(value.type not in NUMBERS for value in values):
            raise self.refused("min or max of what are not numbers", "give numbers")
        if all(value.known is not None for value in values):
            return self.number((min if least else max)(int(value.known or 0) for value in values))
        t = values[0].type
        if any(value.type != t for value in values):
            problem = "min, max of an int and a float"
            raise self.refused(problem, "write 0.0 for 0, or float(...)")
        name = f"{'real' if t == REAL else 'integer'}_{'min' if least else 'max'}"
        code = bare(values[0].code)
        for value in values[1:]:
            code = f"{name}({code}, {bare(value.code)})"
        return Value(t, code)


def bare(code: str) -> str:
    """Return code without brackets around all of it."""
    if code.startswith("(*") and _PLACE.fullmatch(code):
        return code[1:-1]
    if not (code.startswith("(") and code.endswith(")")):
        return code
    depth = 0
    for i, character in enumerate(code):
        depth += (character == "(") - (character == ")")
        if depth == 0 and i < len(code) - 1:
            return code
    return code[1:-1]


def dotted(owner: str) -> str:
    return f"{owner[2:-1]}->" if owner.startswith("(*") else f"{owner}."


def indented(lines: Sequence[str]) -> list[str]:
    """Return lines one step further to the right."""
    return [f"    {line}" for line in lines]


def _parts_of(line: str) -> list[str]:
    """Return a line of C as one or several that are not too long."""
    pad = line[: len(line) - len(line.lstrip())]
    return textwrap.wrap(
        line, _WIDTH, subsequent_indent=f"{pad}    ", break_long_words=False, break_on_hyphens=False
    )


def _qualified(python: Any) -> str:
    """Return a function's module and name."""
    return f"{getattr(python, '__module__', '?')}.{getattr(python, '__qualname__', python)}"


def _first_line(tree: ast.FunctionDef) -> str:
    """Return the first line of a docstring, which ``python -OO`` has not kept; empty if there is none."""
    lines = (ast.get_docstring(tree) or "").splitlines()
    return lines[0].replace("*/", "* /").replace("``", "").replace("`", "") if lines else ""
