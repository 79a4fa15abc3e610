"""Functions outside of the subset that is translated to C, one construct each; `OUTSIDE` says where and why."""
# ruff: noqa

from __future__ import annotations

import math
import time
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

LIMITS = [1.0, 2.0]
SCALES = {"a": 1.0}
ROW = np.zeros(3)
LONG = 2**70
BOX = SimpleNamespace(value=1.0)


class Pair(NamedTuple):
    a: float = 0.0
    b: float = 0.0


def power(x):
    return x**2


def power_in_place(x):
    x **= 3.0
    return x


def tries(x):
    try:
        return 1.0 / x
    except ZeroDivisionError:
        return 0.0


def raises(x):
    if x > 0.0:
        raise ValueError
    return x


def asserts(x):
    assert x > 0.0
    return x


def makes_a_list(x):
    return [x, x][0]


def makes_a_dictionary(x):
    return {1: x}[1]


def makes_a_set(x):
    return 1.0 if x in {1.0, 2.0} else 0.0


def comprehends(x):
    return max([x * k for k in range(3)])


def generates(x):
    return sum(x for _ in range(3))


def defines_a_function(x):
    def twice(y):
        return 2.0 * y

    return twice(x)


def has_a_lambda(x):
    twice = lambda y: 2.0 * y
    return twice(x)


def writes_a_global(x):
    global SCALES
    SCALES = x
    return x


def reads_a_list(x):
    return x + LIMITS[0]


def reads_a_dictionary(x):
    return x * SCALES["a"]


def reads_an_array(x):
    return x * ROW[0]


def reads_an_object(x):
    return x * BOX.value


def calls_sin(x):
    return math.sin(x)


def calls_numpy(x):
    return np.tanh(x)


def calls_pow(x):
    return pow(x, 2.0)


def calls_the_clock(x):
    return x + time.monotonic()


def calls_round(x):
    return round(x)


def calls_itself(x):
    return x if x < 1.0 else calls_itself(x - 1.0)


def takes_any_number(*x):
    return x[0]


def takes_any_names(**x):
    return 1.0


def calls_with_a_star(x):
    return math.copysign(*(x, x))


def divides_floats_by_floor(x):
    return x // 0.1


def takes_the_remainder(x):
    return x % 0.1


def int_then_float(x):
    total = 0
    for _ in range(3):
        total = total + x
    return total


def int_or_float(x):
    return 0 if x > 1.0 else x


def returns_int_or_float(x):
    if x > 1.0:
        return 1
    return x


def returns_nothing_or_float(x):
    if x > 1.0:
        return None
    return x


def none_or_number(x):
    value = None
    if x > 0.0:
        value = x
    return 1.0 if value is None else 2.0


def compares_int_with_float(n, x):
    return 1.0 if n < x else 0.0


def least_of_int_and_float(n, x):
    return min(n, x)


def shifts_by_a_variable(n):
    return 1 << n


def adds_bools(x):
    return (x > 0.0) + (x > 1.0)


def or_of_numbers(x):
    return x or 1.0


def uses_a_string(x):
    mode = "a"
    return x if mode == "a" else 0.0


def formats(x):
    return len(f"{x}")


def walrus(x):
    return (y := x) + y


def unpacks_a_star(x):
    first, *rest = (x, x, x)
    return first


def changes_a_record(pair):
    pair.a = 1.0
    return pair.a


def else_of_a_loop(x):
    for _ in range(3):
        x = x + 1.0
    else:
        x = 0.0
    return x


def unknown_step(n):
    total = 0.0
    for i in range(0, 10, n):
        total = total + float(i)
    return total


def unknown_index_of_mixed(n, x):
    return (x, n)[n]


def orders_tuples(x):
    return 1.0 if (x, 0.0) < (0.0, x) else 0.0


def imports(x):
    import math as m

    return m.floor(x)


def matches(x):
    match x:
        case 1.0:
            return 0.0
    return x


def zips(x):
    total = 0.0
    for a, b in zip((x, x), (1.0, 2.0)):
        total = total + a * b
    return total


def breaks_out_of_unrolled(x):
    for pair in ((x, 1), (2.0, 2)):
        if pair[0] > 1.0:
            break
    return x


def big_number(n):
    return n + 9223372036854775808


def big_opposite(x):
    return float(-(-9223372036854775807 - 1))


def big_quotient(x):
    return float((-9223372036854775807 - 1) // -1)


def big_constant(n):
    return n + LONG


def function_or_function(x):
    f = power
    if x > 0.0:
        f = tries
    return f(x)


def writes_in_an_expression(out, x):
    return _written(out, x) + out[0]


def _written(out, x):
    out[0] = x
    return x


X = (1.0,)
# Function: the expression that is refused, a part of the remedy, examples of its arguments.
OUTSIDE = {
    power: ("x ** 2", "multiply: x * x", X),
    power_in_place: ("x ** 3.0", "multiply", X),
    tries: ("try:", "if", X),
    raises: ("raise ValueError", "hold", X),
    asserts: ("assert x > 0.0", "leave it out", X),
    makes_a_list: ("[x, x]", "tuple", X),
    makes_a_dictionary: ("{1: x}", "named tuple", X),
    makes_a_set: ("{1.0, 2.0}", "comparisons", X),
    comprehends: ("[x * k for k in range(3)]", "loop", X),
    generates: ("(x for _ in range(3))", "loop", X),
    defines_a_function: ("def twice(y)", "module", X),
    has_a_lambda: ("lambda y: 2.0 * y", "def", X),
    writes_a_global: ("global SCALES", "memory", X),
    reads_a_list: ("LIMITS", "tuple", X),
    reads_a_dictionary: ("SCALES", "tuple", X),
    reads_an_array: ("ROW", "tuple", X),
    reads_an_object: ("BOX.value", "constant", X),
    calls_sin: ("math.sin(x)", "trunk_control.api", X),
    calls_numpy: ("np.tanh(x)", "plain function", X),
    calls_pow: ("pow(x, 2.0)", "multiply", X),
    calls_the_clock: ("time.monotonic()", "plain function", X),
    calls_round: ("round(x)", "math.floor", X),
    calls_itself: ("calls_itself", "loop", X),
    takes_any_number: ("*x", "name each", X),
    takes_any_names: ("**x", "name each", X),
    calls_with_a_star: ("math.copysign(*(x, x))", "name each", X),
    divides_floats_by_floor: ("x // 0.1", "math.floor", X),
    takes_the_remainder: ("x % 0.1", "math.floor", X),
    int_then_float: ("total", "0.0 for 0", X),
    int_or_float: ("0 if x > 1.0 else x", "0.0 for 0", X),
    returns_int_or_float: ("return x", "0.0 for 0", X),
    returns_nothing_or_float: ("return x", "one type", X),
    none_or_number: ("value", "another name", X),
    compares_int_with_float: ("n < x", "float(...)", (1, 1.0)),
    least_of_int_and_float: ("min(n, x)", "float(...)", (1, 1.0)),
    shifts_by_a_variable: ("1 << n", "literal", (1,)),
    adds_bools: ("(x > 0.0) + (x > 1.0)", "numbers", X),
    or_of_numbers: ("x", "compare", X),
    uses_a_string: ("mode == 'a'", "numbers", X),
    formats: ("f'{x}'", "numbers", X),
    walrus: ("(y := x)", "line of its own", X),
    unpacks_a_star: ("(first, *rest)", "name each", X),
    changes_a_record: ("pair.a", "_replace", (Pair(),)),
    else_of_a_loop: ("_", "bool", X),
    unknown_step: ("range(0, 10, n)", "literal", (1,)),
    unknown_index_of_mixed: ("(x, n)[n]", "literal", (1, 1.0)),
    orders_tuples: ("(x, 0.0) < (0.0, x)", "numbers", X),
    imports: ("import math as m", "top of the module", X),
    matches: ("match x:", "if and elif", X),
    zips: ("zip((x, x), (1.0, 2.0))", "range", X),
    breaks_out_of_unrolled: ("break", "range", X),
    big_number: ("9223372036854775808", "smaller", (1,)),
    big_opposite: ("-(-9223372036854775807 - 1)", "smaller", X),
    big_quotient: ("(-9223372036854775807 - 1) // -1", "smaller", X),
    big_constant: ("LONG", "smaller", (1,)),
    function_or_function: ("f", "another name", X),
    writes_in_an_expression: ("_written(out, x)", "line of its own", (np.zeros(2), 1.0)),
}
