"""What decides a bit is made of operations that IEEE 754 fixes: a check of the sources."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "ros2_ws" / "src"
# Nodes, plant and laws: whole packages. Of the experiments, what runs, plans and recomputes.
PLACES = (
    "trunk_msgs_util/trunk_msgs_util",
    "trunk_sim/trunk_sim",
    "trunk_control/trunk_control",
    *(
        f"trunk_experiments/trunk_experiments/{folder}"
        for folder in ("plans", "runs", "recorded", "replay", "batch")
    ),
)
# Of `math`: constants, tests, and what is exact or rounded correctly everywhere.
EXACT = {
    *("inf", "nan", "pi", "floor", "ceil", "sqrt", "isfinite", "isinf", "isnan", "copysign"),
    *("nextafter", "ulp", "gcd", "frexp"),
}
# Of NumPy: functions whose last bit is the C library's, or whose order of summation the machine's.
INEXACT = {
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "float_power", "cbrt"),
    *("hypot", "sinc", "dot", "matmul", "einsum", "inner", "tensordot", "linalg", "sum", "mean"),
    *("std", "var", "prod", "interp", "convolve", "default_rng", "Generator"),
}
# Random plans for the checks, not a run's own numbers.
EXCEPT = {"random_plans.py": {"default_rng", "Generator", "**"}}


def files():
    return [path for place in PLACES for path in sorted((SOURCES / place).rglob("*.py"))]


def inexact(tree):
    """Yield what a module uses of which the bits are not fixed."""
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module="math"):
                yield from (name.name for name in node.names if name.name not in EXACT)
            case ast.Import():
                yield from (name.name for name in node.names if name.name == "cmath")
            case ast.Attribute(value=ast.Name(id="np" | "numpy"), attr=name) if name in INEXACT:
                yield name
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name not in EXACT:
                yield name
            case ast.Attribute(attr="Generator" | "standard_normal" as name):
                yield name
            case ast.Call(func=ast.Name(id="pow" | "fsum" as name)):
                yield name
            case ast.BinOp(op=ast.MatMult()):
                yield "@"
            case ast.BinOp(op=ast.Pow(), left=left, right=right):
                if not (whole(left) and whole(right)):
                    yield "**"


def whole(node):
    """Return True for a whole number: powers of such are computed when the file is read, exactly."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node = node.operand
    return isinstance(node, ast.Constant) and float(node.value).is_integer()


@pytest.mark.parametrize("path", files(), ids=lambda path: str(path.relative_to(SOURCES)))
def test_no_function_of_the_c_library_decides_a_bit(path):
    found = set(inexact(ast.parse(path.read_text())))
    assert found - EXCEPT.get(path.name, set()) == set()


@pytest.mark.parametrize(
    "text",
    [
        "from math import sin",
        "import math\nmath.exp(1.0)",
        "import numpy as np\nnp.sin(x)",
        "x ** 0.5",
        "x ** 2",
        "2.5 ** 2",
        "a @ b",
        "pow(x, 2.0)",
        "np.random.Generator(np.random.PCG64(1)).standard_normal()",
        "x.sum(np.sum(y))",
    ],
)
def test_the_check_finds(text):
    assert list(inexact(ast.parse(text)))


@pytest.mark.parametrize("text", ["2.0**-53", "2**20", "from math import sqrt, floor, pi"])
def test_the_check_lets_pass(text):
    assert not list(inexact(ast.parse(text)))
