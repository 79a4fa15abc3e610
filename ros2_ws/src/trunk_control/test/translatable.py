"""Functions of the subset that is translated to C; `CALLS` has examples of their arguments."""
# ruff: noqa

import math
from math import inf, nan, sqrt
from typing import NamedTuple

from trunk_control.api import atan2, cos, exp, log, sin, tanh
from trunk_control.api import sqrt as root

TABLE = (0.5, -1.25, 3.0, 0.1, 1e-300, 7.0, -0.0)
WHOLE = (5, -3, 2, 9, 4, 0)
FIRST, SECOND = range(2)
THIRD = 1.0 / 3.0


class Pair(NamedTuple):
    a: float = 0.1
    double: float = -0.0


class Inner(NamedTuple):
    pair: Pair
    count: int = 3
    on: bool = True


class Memory(NamedTuple):
    past: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    effort: float = 0.0


def integer_division(a, b):
    d = b if b != 0 else 7
    return a // d, a % d, a / d, -a // d, (a + 3) // 4, (a - 3) % 8


def least_and_greatest(a, b, c):
    return min(a, b), max(a, b), min(a, b, c), max(a, b, c), min(max(a, b), c)


def whole_least(i, j):
    return min(i, j), max(i, j, 0), abs(i), abs(j - i)


def nan_comparisons(a, b):
    low = 0
    if not a > b:
        low += 1
    if a != a:
        low += 2
    if a == b:
        low += 4
    if not (a < b or a >= b):
        low += 8
    return low


def chained(a, b, c):
    return 1 if a < b <= c else 2 if a >= b > c else 3


def swaps(a, b, c):
    a, b = b, a
    b, c, a = a + 1.0, b - 1.0, c * 0.5
    return a, b, c


def shadows(a, b):
    sin = a * 2.0
    exp = b
    double = sin - exp
    register = double + THIRD
    a_ = register
    a = a_ + a
    return a, sin, exp


def nested(inner, x):
    (a, double), count, on = inner
    new = inner._replace(pair=inner.pair._replace(double=x, a=double), count=count + 1)
    return new, Inner(Pair(), count, not on), new.pair == inner.pair


def keeps_order(pair):
    pair = Pair(pair.double, pair.a)
    pair = pair._replace(a=pair.double, double=pair.a)
    return pair


def loops(n, x):
    total = 0.0
    k = 0
    for i in range(n % 7):
        if i == 2:
            continue
        total += x * i
        k = i
    for j in range(10, n % 5, -3):
        total -= j / 7
        if total < -5.0:
            break
    for value in TABLE:
        total += value
    for w in WHOLE:
        if w == 9:
            break
        k += w
    while 10.0 < total < 1e300:
        total *= 0.5
    return total, k


def loop_variable(n):
    i = -1
    last = 0
    for i in range(n % 4):
        last += i
    return i, last


def keeps_over_rounds(n, x):
    before = x
    total = 0.0
    for k in range(n % 6):
        if k == 0:
            held = x
        total += held
        held = held * 0.5
        now = before + 1.0
        total += now * k
        before = now * 0.5
    return total, before


def unrolls(x, y):
    total = 0.0
    for low, high, place in ((x, y, FIRST), (y, x * 2.0, SECOND), (0.0, 1.0, 4)):
        if low < high:
            total += high - low + place
    for place in (FIRST, SECOND, 4):
        total += TABLE[place]
    return total


def indices(i, x):
    small = (x, 2.0 * x, x - 1.0)
    return (
        TABLE[i % 7],
        TABLE[-2],
        TABLE[(i % 3) - 2],
        small[i % 3],
        small[(i % 3) - 3],
        WHOLE[i % 6],
    )


def history(memory, x):
    past = (x, *memory.past[:-1])
    total = 0.0
    for i in range(len(past)):
        total += past[i]
    return memory._replace(past=past, effort=total), past[2], len(memory.past)


def short_circuits(i, x):
    inside = 0 <= i and i < len(TABLE) and TABLE[i] > x
    wide = i < 0 or max(TABLE[i % 7], x) > 0.5 or x != x
    chosen = max(TABLE[min(i, 6)], 0.0) if i >= 0 else x
    return inside, wide, chosen


def optional(x, scale=None):
    if scale is None:
        scale = 2.0
    return x * scale if scale > 1.0 else x


def calls_with_names(x, y):
    return optional(x), optional(x, scale=y), optional(scale=0.5, x=x)


def several_results(x):
    a, b = part(x), 1
    whole = part(x)
    return a[0] - 2.0 * whole[1], b


def part(x):
    if x > 0.0:
        return x, -x
    return 0.25 * x, x


def elementary(x):
    return sin(x), cos(x), exp(x), log(x), sqrt(x) if x >= 0.0 else nan


def more_elementary(x, y):
    return tanh(x), atan2(x, y), root(x), exp(x)


def numbers(x, i):
    small = math.floor(x) if -1e15 < x < 1e15 else 0
    high = math.ceil(x) if -1e15 < x < 1e15 else 0
    cut = int(x) if -1e15 < x < 1e15 else 0
    return (
        small,
        high,
        cut,
        math.copysign(2.0, x) if x == x else 0.0,
        math.isfinite(x),
        math.isinf(x),
        math.isnan(x),
        abs(x),
        -x,
        i & 6,
        i | 1,
        ~i,
        i >> 3,
        (i & 255) << 2,
        float(i),
    )


def bools(a, b, p, q):
    both = p and not q
    if p == q:
        both = not both
    return both, p or (q and a > b), (a > b) == p


def several_targets(x):
    a = b = x * 3.0
    a += 1.0
    c = d = Pair(a, b)
    c = c._replace(a=0.0)
    return a, b, c, d


def infinities(x):
    return x < inf, -inf <= x, nan, inf


def early(pair, x):
    if x > 0.5:
        return pair
    other = Pair(pair.a + x, pair.double)
    if x < -0.5:
        return other
    return Pair(other.double, pair.a)


def crossed(pair, x):
    return Pair(pair.double, pair.a + x)


def writes_over(pair, x):
    pair = crossed(pair, x)
    pair = crossed(pair, pair.a)
    return pair


def wide_integers(i):
    whole = 0
    for k in range(3):
        whole = whole * 100000007 + (i + k)
    return whole, whole / 3, whole / 1_000_000_007


REAL, INT, BOOL, PAIR = 1.0, 1, True, Pair()
INNER = Inner(Pair())
CALLS = {
    integer_division: (INT, INT),
    least_and_greatest: (REAL, REAL, REAL),
    whole_least: (INT, INT),
    nan_comparisons: (REAL, REAL),
    chained: (REAL, REAL, REAL),
    swaps: (REAL, REAL, REAL),
    shadows: (REAL, REAL),
    nested: (INNER, REAL),
    keeps_order: (PAIR,),
    loops: (INT, REAL),
    loop_variable: (INT,),
    keeps_over_rounds: (INT, REAL),
    unrolls: (REAL, REAL),
    indices: (INT, REAL),
    history: (Memory(), REAL),
    short_circuits: (INT, REAL),
    calls_with_names: (REAL, REAL),
    several_results: (REAL,),
    elementary: (REAL,),
    more_elementary: (REAL, REAL),
    numbers: (REAL, INT),
    bools: (REAL, REAL, BOOL, BOOL),
    several_targets: (REAL,),
    infinities: (REAL,),
    early: (PAIR, REAL),
    writes_over: (PAIR, REAL),
    wide_integers: (INT,),
}
