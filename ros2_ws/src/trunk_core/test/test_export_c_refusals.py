import math
import re
import time
from textwrap import indent
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from trunk_core.c.translate import Program
from trunk_core.c.types import UntranslatableError, type_of


class Pair(NamedTuple):
    a: float = 0.0
    b: float = 0.0


def written(out, x):
    out[0] = x
    return x


# Bodies of f(n, x, pair, out), each up to a return at the margin, or functions in one line.
# Behind what is refused: how its text begins | a part of the remedy.
OUTSIDE = """\
return x**2  # x ** 2 | multiply: x * x
x **= 3.0  # x ** 3.0 | multiply
return x
try: x = 1.0 / x  # try: | if
except ZeroDivisionError: x = 0.0
return x
if x > 0.0: raise ValueError  # raise ValueError | hold
return x
assert x > 0.0  # assert x > 0.0 | leave it out
return x
return [x, x][0]  # [x, x] | tuple
return {1: x}[1]  # {1: x} | named tuple
return 1.0 if x in {1.0, 2.0} else 0.0  # {1.0, 2.0} | comparisons
return max([x * k for k in range(3)])  # [x * k for k in range(3)] | loop
return sum(x for _ in range(3))  # (x for _ in range(3)) | loop
def twice(y): return 2.0 * y  # def twice(y) | module
return twice(x)
twice = lambda y: 2.0 * y  # lambda y: 2.0 * y | def
return twice(x)
global SCALES  # global SCALES | memory
SCALES = x
return x
return x + LIMITS[0]  # LIMITS | tuple
return x * SCALES["a"]  # SCALES | tuple
return x * ROW[0]  # ROW | tuple
return x * BOX.value  # BOX.value | constant
return math.sin(x)  # math.sin(x) | trunk_control.api
return np.tanh(x)  # np.tanh(x) | plain function
return pow(x, 2.0)  # pow(x, 2.0) | multiply
return x + time.monotonic()  # time.monotonic() | plain function
return round(x)  # round(x) | math.floor
def f(x): return x if x < 1.0 else f(x - 1.0)  # f | loop
def f(*x): return x[0]  # *x | name each
def f(**x): return 1.0  # **x | name each
return math.copysign(*(x, x))  # math.copysign(*(x, x)) | name each
return x // 0.1  # x // 0.1 | math.floor
return x % 0.1  # x % 0.1 | math.floor
total = 0
for _ in range(3):
    total = total + x  # total | 0.0 for 0
return total
return 0 if x > 1.0 else x  # 0 if x > 1.0 else x | 0.0 for 0
if x > 1.0: return 1
return x  # return x | 0.0 for 0
if x > 1.0: return None
return x  # return x | one type
value = None
if x > 0.0: value = x  # value | another name
return 1.0 if value is None else 2.0
return 1.0 if n < x else 0.0  # n < x | float(...)
return min(n, x)  # min(n, x) | float(...)
return 1 << n  # 1 << n | literal
return (x > 0.0) + (x > 1.0)  # (x > 0.0) + (x > 1.0) | numbers
return x or 1.0  # x | compare
mode = "a"
return x if mode == "a" else 0.0  # mode == 'a' | numbers
return len(f"{x}")  # f'{x}' | numbers
return (y := x) + y  # (y := x) | line of its own
first, *rest = (x, x, x)  # (first, *rest) | name each
return first
pair.a = 1.0  # pair.a | _replace
return pair.a
for _ in range(3):  # _ | bool
    x = x + 1.0
else: x = 0.0
return x
total = 0.0
for i in range(0, 10, n):  # range(0, 10, n) | literal
    total = total + float(i)
return total
return (x, n)[n]  # (x, n)[n] | literal
return 1.0 if (x, 0.0) < (0.0, x) else 0.0  # (x, 0.0) < (0.0, x) | numbers
import math as m  # import math as m | top of the module
return m.floor(x)
match x:  # match x: | if and elif
    case 1.0: x = 0.0
return x
total = 0.0
for a, b in zip((x, x), (1.0, 2.0)):  # zip((x, x), (1.0, 2.0)) | range
    total = total + a * b
return total
for one in ((x, 1), (2.0, 2)):
    if one[0] > 1.0: break  # break | range
return x
return n + 9223372036854775808  # 9223372036854775808 | smaller
return float(-(-9223372036854775807 - 1))  # -(-9223372036854775807 - 1) | smaller
return float((-9223372036854775807 - 1) // -1)  # (-9223372036854775807 - 1) // -1 | smaller
return n + LONG  # LONG | smaller
g = type_of
if x > 0.0: g = written  # g | another name
return g(x)
return written(out, x) + out[0]  # written(out, x) | line of its own
"""
PROGRAMS = re.findall(r"(?ms)^.*?^(?:return|def f).*?\n", OUTSIDE)
NAMES = SimpleNamespace(
    **{m.__name__: m for m in (math, time, type_of, written)},
    np=np,
    LIMITS=[1.0, 2.0],
    SCALES={"a": 1.0},
    ROW=np.zeros(3),
    LONG=2**70,
    BOX=SimpleNamespace(value=1.0),
    __name__=__name__,
)


@pytest.mark.parametrize("program", PROGRAMS)
def test_outside_of_the_subset_with_line_and_remedy(program, tmp_path):
    examples = [1, 1.0, Pair(), np.zeros(2)]
    if program.startswith("def f"):
        examples = [1.0]
    else:
        program = f"def f(n, x, pair, out):\n{indent(program, '    ')}"
    (tmp_path / "f.py").write_text(program)
    names = dict(vars(NAMES))
    exec(compile(program, tmp_path / "f.py", "exec"), names)
    with pytest.raises(UntranslatableError) as caught:
        Program().function(names["f"], [type_of(example) for example in examples])
    error = caught.value
    ((number, text, remedy),) = (
        (number, *line.partition("  # ")[2].split(" | "))
        for number, line in enumerate(program.splitlines(), 1)
        if "  # " in line
    )
    assert (error.function, error.line) == (f"{__name__}.f", number)
    assert error.text.startswith(text)
    assert remedy in error.remedy
    assert str(error).count("\n") == 0
    assert f"line {number}" in str(error)
