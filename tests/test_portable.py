"""What decides a bit is made of operations that IEEE 754 fixes: a check of the sources."""

import ast
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / "ros2_ws" / "src"
# What runs, plans and recomputes.
PLACES = (
    *(
        f"trunk_{name}/trunk_{name}"
        for name in ("core", "recording", "msgs_util", "sim", "control")
    ),
    *(
        "trunk_runs/trunk_runs",
        "trunk_evidence/trunk_evidence",
        "trunk_studies/trunk_studies/batch",
    ),
)
DRAWS = "trunk_studies/trunk_studies/study.py"
# Of `math`: constants, tests, and what is exact or rounded correctly everywhere.
EXACT = {
    *("inf", "nan", "pi", "floor", "ceil", "sqrt", "isfinite", "isinf", "isnan", "copysign"),
    *("nextafter", "ulp", "gcd", "frexp", "ldexp", "isclose"),
}
# Of NumPy: what makes, moves, compares and rounds; `PCG64` for its raw stream.
EXACT_OF_NUMPY = {
    *(
        "ndarray",
        "dtype",
        "void",
        "uint8",
        "uint64",
        "int32",
        "int64",
        "float64",
        "integer",
        "bool_",
        "nan",
    ),
    *(
        "array",
        "asarray",
        "ascontiguousarray",
        "empty",
        "zeros",
        "ones",
        "full",
        "arange",
        "frombuffer",
        "empty_like",
        "divmod",  # of integers
    ),
    *(
        "concatenate",
        "column_stack",
        "delete",
        "repeat",
        "ravel",
        "where",
        "flatnonzero",
        "argwhere",
        "nonzero",
    ),
    *(
        "sort",
        "argsort",
        "unique",
        "searchsorted",
        "isin",
        "setdiff1d",
        "setxor1d",
        "union1d",
        "lexsort",
    ),
    *(
        "diff",
        "cumsum",
        "ptp",
        "abs",
        "minimum",
        "maximum",
        "floor",
        "sign",
        "equal",
        "array_equal",
    ),
    *(
        "isfinite",
        "isnan",
        "signbit",
        "any",
        "all",
        "count_nonzero",
        "lib",
        "random",
        "errstate",
        "iinfo",
    ),
    *(
        "intersect1d",
        "bincount",
        "stack",
        "vstack",
        "broadcast_to",
        "issubdtype",
        "datetime64",
    ),
    *(
        "maximum",
        "generic",
        "number",
        "floating",
        "str_",
        "clip",
        "split",
        "append",
        "hstack",
        "rint",
        "add",
        "fromfile",
        "int32",  # places in a list of frames
        "argmax",
        "argmin",
        "nan_to_num",
    ),
}
# Methods whose order of operations is the machine's, and generators other than a raw stream.
INEXACT_METHODS = {
    "sum",
    "mean",
    "std",
    "var",
    "prod",
    "dot",
    "Generator",
    "standard_normal",
    "normal",
}
FORBIDDEN = {"cmath", "random", "statistics", "scipy"}
EXCEPT = {
    # Its numbers between 0 and 1 and its integers; NumPy may change how the latter are drawn.
    # The values of a grid are kept with its results.
    "study.py": {"Generator", "SeedSequence", "unravel_index", "linspace", "geomspace", "degrees"},
    "doctor.py": {"median"},
    "doubts.py": {"degrees", "median"},  # for words about a run
    "plan.py": {"degrees"},  # likewise
    "quantity.py": {"**"},  # of fractions, exact
}
# Reading and comparing count with these; they compute no number of a run.
COUNTING = ("/trunk_recording/", "/trunk_evidence/")
# What is said of a run in numbers: no bit of a run depends on it.
OF_A_RUN = {"run_metrics.py", "run_table.py", "parameter_text.py"}
# Rule files of other programs, computed as those do; texts in C.
OTHERS = {"rulebase", "c"}


def files():
    whole = [path for place in PLACES for path in sorted((SOURCES / place).rglob("*.py"))]
    counted = [
        path for path in whole if path.name not in OF_A_RUN and path.parent.name not in OTHERS
    ]
    return [*counted, SOURCES / DRAWS]


def inexact(tree):
    """Yield what a module uses whose bits are not fixed."""
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module="math"):
                yield from (name.name for name in node.names if name.name not in EXACT)
            case ast.ImportFrom(module=str(module)):
                package = module.split(".")[0]
                if package in FORBIDDEN or (package == "numpy" and module != "numpy.typing"):
                    yield module
            case ast.Import():
                for name in node.names:
                    if name.name.split(".")[0] in FORBIDDEN:
                        yield name.name
                    elif name.name in ("math", "numpy") and name.asname not in (None, "np"):
                        yield f"{name.name} as {name.asname}"
            case ast.Attribute(value=ast.Name(id="np" | "numpy"), attr=name):
                if name not in EXACT_OF_NUMPY:
                    yield name
            case ast.Attribute(value=ast.Name(id="math"), attr=name):
                if name not in EXACT:
                    yield name
            case ast.Attribute(value=ast.Attribute(attr="random"), attr=name):
                if name != "PCG64":
                    yield name
            case ast.Call(func=ast.Attribute(attr=name)) if name in INEXACT_METHODS:
                yield name
            case ast.Attribute(attr="Generator" | "reduce" as name):
                yield name
            case ast.Call(func=ast.Name(id="pow" | "fsum" as name)):
                yield name
            case ast.keyword(arg="fastmath"):
                yield "fastmath"
            case ast.BinOp(op=ast.MatMult()):
                yield "@"
            case ast.AugAssign(op=ast.Pow() | ast.MatMult()):
                yield "**="
            case ast.BinOp(op=ast.Pow(), left=left, right=right):
                if not exact_power(left, right):
                    yield "**"


def exact_power(left, right):
    """Return True for a power of two, and for one of whole numbers."""
    negative = isinstance(right, ast.UnaryOp) and isinstance(right.op, ast.USub)
    exponent = right.operand if negative else right
    if not (isinstance(left, ast.Constant) and isinstance(exponent, ast.Constant)):
        return False
    if type(exponent.value) is not int:
        return False
    return left.value == 2 or (type(left.value) is int and not negative)


@pytest.mark.slow
@pytest.mark.parametrize("path", files(), ids=lambda path: str(path.relative_to(SOURCES)))
def test_no_function_of_the_c_library_decides_a_bit(path):
    found = set(inexact(ast.parse(path.read_text())))
    if any(folder in str(path) for folder in COUNTING):
        found -= {"sum"}
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
        "x.sum()",
        "x **= 2",
        "10**-9",
        "3.0**40",
        "from numpy import sin",
        "import math as m",
        "from cmath import exp",
        "from scipy.special import ndtri",
        "import statistics",
        "np.random.default_rng(1)",
        "np.random.Generator",
        "np.geomspace(1, 2)",
        "np.add.reduce(x)",
        "numba.njit(fastmath=True)",
    ],
)
def test_the_check_finds(text):
    assert list(inexact(ast.parse(text)))


@pytest.mark.parametrize("text", ["2.0**-53", "2**20", "from math import sqrt, floor, pi"])
def test_the_check_lets_pass(text):
    assert not list(inexact(ast.parse(text)))
