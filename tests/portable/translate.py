"""`elementary` in C and in JavaScript: the same operations in the same order, from its source.

Knows what these functions are made of: assignments, ``if``, ``return``, a loop over constants, arithmetic,
and comparisons. Anything else is an error.
"""

import ast
from pathlib import Path

from trunk_core import elementary

C, JAVASCRIPT = "c", "js"
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.USub: "-"}
_COMPARISONS = {
    ast.LtE: "<=",
    ast.GtE: ">=",
    ast.Lt: "<",
    ast.Gt: ">",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


class Translator:
    """Translates functions of floats into one of the languages."""

    def __init__(self, language: str) -> None:
        self.language = language

    def expression(self, node: ast.expr) -> str:
        """Return an expression, with each operation in brackets: its order stays."""
        match node:
            case ast.Name(id=name):
                return name
            case ast.Constant(value=value):
                return repr(float(value))
            case ast.BinOp(op=op, left=a, right=b):
                return f"({self.expression(a)} {_OPERATORS[type(op)]} {self.expression(b)})"
            case ast.UnaryOp(op=ast.Not(), operand=a):
                return f"!({self.expression(a)})"
            case ast.UnaryOp(op=ast.USub(), operand=a):
                return f"(-{self.expression(a)})"
            case ast.BoolOp(op=ast.Or(), values=values):
                return "(" + " || ".join(map(self.expression, values)) + ")"
            case ast.Compare(left=left, ops=ops, comparators=others):
                terms = [left, *others]
                pairs = (
                    f"{self.expression(a)} {_COMPARISONS[type(op)]} {self.expression(b)}"
                    for a, op, b in zip(terms, ops, terms[1:], strict=False)
                )
                return "(" + " && ".join(pairs) + ")"
            case ast.IfExp(test=test, body=a, orelse=b):
                return f"({self.expression(test)} ? {self.expression(a)} : {self.expression(b)})"
            case ast.Subscript(value=a, slice=ast.Name(id=i)):
                return f"{self.expression(a)}[{i}]"
            case ast.Call(func=ast.Name(id="float"), args=[ast.Constant(value="inf")]):
                return "INFINITY"
            case ast.Call(func=ast.Name(id="float"), args=[a]):
                return self.expression(a)
        raise NotImplementedError(ast.unparse(node))

    def statement(self, node: ast.stmt) -> str:
        """Return a statement."""
        match node:
            case ast.Expr(value=ast.Constant()):  # a docstring
                return ""
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                return f"{name} = {self.expression(value)};"
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                pairs = zip(names, values, strict=True)
                return " ".join(f"{self.expression(n)} = {self.expression(v)};" for n, v in pairs)
            case ast.AugAssign(target=ast.Name(id=name), op=op, value=value):
                return f"{name} = {name} {_OPERATORS[type(op)]} {self.expression(value)};"
            case ast.If(test=test, body=body, orelse=orelse):
                other = f" else {{ {self.block(orelse)} }}" if orelse else ""
                return f"if ({self.expression(test)}) {{ {self.block(body)} }}{other}"
            case ast.For(target=ast.Name(id=i), body=body):  # over the powers of two
                kind = "int" if self.language == C else "let"
                count = len(elementary._POWERS)
                return f"for ({kind} {i} = 0; {i} < {count}; {i}++) {{ {self.block(body)} }}"
            case ast.Return(value=ast.Tuple(elts=[a, b])):
                if self.language == C:
                    return f"return (pair){{{self.expression(a)}, {self.expression(b)}}};"
                return f"return [{self.expression(a)}, {self.expression(b)}];"
            case ast.Return(value=value) if value is not None:
                return f"return {self.expression(value)};"
        raise NotImplementedError(ast.unparse(node))

    def block(self, statements: list[ast.stmt]) -> str:
        """Return statements, a line each."""
        return "\n".join(filter(None, map(self.statement, statements)))

    def function(self, node: ast.FunctionDef) -> str:
        """Return a function of x."""
        names = sorted(
            name.id
            for name in ast.walk(node)
            if isinstance(name, ast.Name)
            and isinstance(name.ctx, ast.Store)
            and name.id not in "xi"
        )
        declared = ", ".join(dict.fromkeys(names))
        body = self.block(node.body)
        if self.language == JAVASCRIPT:
            return f"function {node.name}(x) {{\nlet {declared};\n{body}\n}}\n"
        kind = "pair" if node.name == "sincos" else "double"
        return f"static {kind} my_{node.name}(double x) {{\ndouble {declared};\n{body}\n}}\n"


def constants(language: str) -> str:
    """Return the module's numbers and tables of numbers."""
    found = ["const INFINITY = Infinity;"] if language == JAVASCRIPT else []
    kind, brackets = ("const double", "{}") if language == C else ("const", "[]")
    for name, value in vars(elementary).items():
        if name.isupper() or name.lstrip("_")[:1].isdigit():
            if isinstance(value, float):
                found.append(f"{kind} {name} = {'NAN' if value != value else repr(value)};")
            elif isinstance(value, tuple):
                array = "[]" if language == C else ""
                inside = ", ".join(repr(float(one)) for one in value)
                found.append(f"{kind} {name}{array} = {brackets[0]}{inside}{brackets[1]};")
    text = "\n".join(found) + "\n"
    return text if language == C else text.replace("NAN", "NaN").replace("const _NaN", "const _NAN")


def translated(language: str) -> str:
    """Return sincos, exp and log, and their constants."""
    tree = ast.parse(Path(elementary.__file__).read_text(encoding="utf-8"))
    translator = Translator(language)
    functions = [
        translator.function(node)
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name in ("sincos", "exp", "log")
    ]
    return constants(language) + "\n".join(functions)
