"""Elementary functions that have the same bits on every machine.

IEEE 754 fixes the result of + - * / to the last bit, but not that of sin, exp and log: each libm has its
own, and glibc picks one by the processor. These functions are made of fixed operations in a stated order
alone, so that CPython, compiled code, C without contraction (``-ffp-contract=off``) and JavaScript return the
same bits. Python never contracts; numba does not unless told to.

Methods and coefficients are those of fdlibm (Sun Microsystems, 1993: k_sin.c, k_cos.c, e_exp.c, e_log.c,
s_atan.c, e_atan2.c).
The largest errors were measured against mpmath; ``test_elementary.py`` repeats this.

Pure: functions of floats, which CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

import math

_NAN = float("nan")

# x + this - this is the integer nearest to x if abs(x) < 2**51: the sum has no bits left for a fraction.
_ROUND = 6755399441055744.0  # 1.5 * 2**52
_2_PI = 6.28318530717958623200e00
_QUARTER_PI = 7.85398163397448278999e-01
_2_OVER_PI = 6.36619772367581382433e-01
# pi/2 = the sum of these. The first three have 33 bits each: a whole number below 2**20 times one of them
# is exact.
_HALF_PI_1 = 1.57079632673412561417e00
_HALF_PI_2 = 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624871116645580e-21
_HALF_PI_4 = 8.47842766036889956997e-32
LARGEST_ANGLE = 1647099.0  # rad, below 2**20 pi/2

_S1 = -1.66666666666666324348e-01
_S2 = 8.33333333332248946124e-03
_S3 = -1.98412698298579493134e-04
_S4 = 2.75573137070700676789e-06
_S5 = -2.50507602534068634195e-08
_S6 = 1.58969099521155010221e-10
_C1 = 4.16666666666666019037e-02
_C2 = -1.38888888888741095749e-03
_C3 = 2.48015872894767294178e-05
_C4 = -2.75573143513906633035e-07
_C5 = 2.08757232129817482790e-09
_C6 = -1.13596475577881948265e-11

_1_OVER_LN2 = 1.44269504088896338700e00
_LN2_HIGH = 6.93147180369123816490e-01  # 33 bits
_LN2_LOW = 1.90821492927058770002e-10
_P1 = 1.66666666666666019037e-01
_P2 = -2.77777777770155933842e-03
_P3 = 6.61375632143793436117e-05
_P4 = -1.65339022054652515390e-06
_P5 = 4.13813679705723846039e-08
LARGEST_EXPONENT = 709.0
SMALLEST_EXPONENT = -708.0

_L1 = 6.666666666666735130e-01
_L2 = 3.999999999940941908e-01
_L3 = 2.857142874366239149e-01
_L4 = 2.222219843214978396e-01
_L5 = 1.818357216161805012e-01
_L6 = 1.531383769920937332e-01
_L7 = 1.479819860511658591e-01
_SQRT_HALF = 7.07106781186547524401e-01
SMALLEST_NORMAL = 2.2250738585072014e-308  # 2**-1022
# An arctangent's ends of intervals; its value between them, in two parts; the series there.
_AT_ENDS = (0.4375, 0.6875, 1.1875, 2.4375)
# fmt: off
_AT_HIGH = (4.63647609000806093515e-01, _QUARTER_PI, 9.82793723247329054082e-01, 2.0 * _QUARTER_PI)
_AT_LOW = (2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17,
           6.12323399573676603587e-17)
_AT_ODD = (3.33333333333329318027e-01, 1.42857142725034663711e-01, 9.09088713343650656196e-02,
           6.66107313738753120669e-02, 4.97687799461593236017e-02, 1.62858201153657823623e-02)
_AT_EVEN = (-1.99999999998764832476e-01, -1.11111104054623557880e-01, -7.69187620504482999495e-02,
            -5.83357013379057348645e-02, -3.65315727442169155270e-02)
# fmt: on
# 2**p and 2**-p for p = 512, 256, ..., 1.
_POWERS = (512.0, 256.0, 128.0, 64.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0)
_UP = tuple(float(1 << int(p)) for p in _POWERS)
_DOWN = tuple(1.0 / power for power in _UP)


def sincos(x: float) -> tuple[float, float]:
    """Return the sine and the cosine of an angle in rad, each within 1 ULP; sin(-0) is -0.

    The angle is reduced to [-pi/4, pi/4] by whole multiples of pi/2 (Cody and Waite), the remainder kept
    in two parts. NaN for both where abs(x) is beyond `LARGEST_ANGLE`, infinite, or NaN.
    """
    if not -LARGEST_ANGLE <= x <= LARGEST_ANGLE:
        return _NAN, _NAN
    n, y, z = 0.0, x, 0.0
    if not -_QUARTER_PI <= x <= _QUARTER_PI:
        n = x * _2_OVER_PI + _ROUND - _ROUND
        a = x - n * _HALF_PI_1  # exact, as each product is
        b = n * _HALF_PI_2
        c = a - b
        d = c - a
        low = (a - (c - d)) - (b + d)  # what the rounding of c has lost
        b = n * _HALF_PI_3
        a = c - b
        d = a - c
        low = low + ((c - (a - d)) - (b + d)) - n * _HALF_PI_4
        y = a + low
        z = low - (y - a)

    q = y * y
    v = q * y
    r = _S2 + q * (_S3 + q * (_S4 + q * (_S5 + q * _S6)))
    s = y - ((q * (0.5 * z - v * r) - z) - v * _S1)
    r = q * (_C1 + q * (_C2 + q * (_C3 + q * (_C4 + q * (_C5 + q * _C6)))))
    half = 0.5 * q
    w = 1.0 - half
    co = w + (((1.0 - w) - half) + (q * r - y * z))

    quadrant = n - 4.0 * (0.25 * n + _ROUND - _ROUND)  # -2 ... 2
    if quadrant == 0.0:
        return s, co
    if quadrant == 1.0:
        return co, -s
    if quadrant == -1.0:
        return -co, s
    return -s, -co


def sin(x: float) -> float:
    """Return the sine of an angle in rad, as `sincos` does."""
    return sincos(x)[0]


def cos(x: float) -> float:
    """Return the cosine of an angle in rad, as `sincos` does."""
    return sincos(x)[1]


def sine_wave(turns: float, phase: float) -> float:
    """Return ``sin(2 pi turns + phase)``, phase in rad; whole turns are dropped, however many."""
    return sin(_2_PI * (turns - (turns + _ROUND - _ROUND)) + phase)


def exp(x: float) -> float:
    """Return e to the power of x, within 1 ULP.

    ::

        x = k ln 2 + r,  abs(r) <= ln(2)/2;   exp(x) = 2^k exp(r)

    0 below `SMALLEST_EXPONENT`, where the result would be near the smallest numbers; infinity above
    `LARGEST_EXPONENT`; NaN for NaN.
    """
    if x != x:
        return _NAN
    if x > LARGEST_EXPONENT:
        return float("inf")
    if x < SMALLEST_EXPONENT:
        return 0.0
    k = x * _1_OVER_LN2 + _ROUND - _ROUND
    high = x - k * _LN2_HIGH
    low = k * _LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (_P1 + t * (_P2 + t * (_P3 + t * (_P4 + t * _P5))))
    y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    left = k if k >= 0.0 else -k
    for i in range(len(_POWERS)):
        if left >= _POWERS[i]:
            left -= _POWERS[i]
            y *= _UP[i] if k >= 0.0 else _DOWN[i]
    return y


def log(x: float) -> float:
    """Return the natural logarithm of x, within 1 ULP; that of 1 is +0.

    ::

        x = 2^k (1 + f),  sqrt(1/2) <= 1 + f < sqrt(2);   ln x = k ln 2 + ln(1 + f)

    NaN for 0, negative numbers, those below `SMALLEST_NORMAL`, infinity and NaN.
    """
    if not x >= SMALLEST_NORMAL or x - x != 0.0:
        return _NAN
    k = 0.0
    for i in range(len(_POWERS)):  # by powers of two: each product is exact
        if x >= _UP[i]:
            x *= _DOWN[i]
            k += _POWERS[i]
        elif x < _DOWN[i]:
            x *= _UP[i]
            k -= _POWERS[i]
    if x < _SQRT_HALF:
        x += x
        k -= 1.0
    elif x >= 2.0 * _SQRT_HALF:
        x *= 0.5
        k += 1.0
    f = x - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    t1 = w * (_L2 + w * (_L4 + w * _L6))
    t2 = z * (_L1 + w * (_L3 + w * (_L5 + w * _L7)))
    half = 0.5 * f * f
    return k * _LN2_HIGH - ((half - (s * (half + (t1 + t2)) + k * _LN2_LOW)) - f)


def sqrt(x: float) -> float:
    """Return the square root, correctly rounded as IEEE 754 has it; NaN for negative numbers and NaN."""
    return math.sqrt(x) if x >= 0.0 else _NAN


def tanh(x: float) -> float:
    """Return the hyperbolic tangent, within 2 ULP; NaN for NaN.

    ::

        tanh x = x / (1 + x^2 / (3 + x^2 / (5 + ... / 15))),  abs(x) < 0.55
               = 1 - 2 / (exp(2 x) + 1),                      x >= 0.55
    """
    if -0.55 < x < 0.55:
        q = x * x
        below = 15.0
        for n in (13.0, 11.0, 9.0, 7.0, 5.0, 3.0, 1.0):
            below = n + q / below
        return x / below
    value = 1.0 - 2.0 / (exp(2.0 * abs(x)) + 1.0)
    return value if x > 0.0 else -value


def _atan(x: float) -> float:
    """Return the arctangent of a number that is not negative, rad."""
    if x < 1e-9:
        return x
    if x < _AT_ENDS[0]:
        high, low, t = 0.0, 0.0, x
    elif x < _AT_ENDS[1]:
        high, low, t = _AT_HIGH[0], _AT_LOW[0], (2.0 * x - 1.0) / (2.0 + x)
    elif x < _AT_ENDS[2]:
        high, low, t = _AT_HIGH[1], _AT_LOW[1], (x - 1.0) / (x + 1.0)
    elif x < _AT_ENDS[3]:
        high, low, t = _AT_HIGH[2], _AT_LOW[2], (x - 1.5) / (1.0 + 1.5 * x)
    else:
        high, low, t = _AT_HIGH[3], _AT_LOW[3], -1.0 / x
    z = t * t
    w = z * z
    a, b, c, d, e, f = _AT_ODD
    odd = z * (a + w * (b + w * (c + w * (d + w * (e + w * f)))))
    a, b, c, d, e = _AT_EVEN
    even = w * (a + w * (b + w * (c + w * (d + w * e))))
    return high - ((t * (odd + even) - low) - t)


def atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y) in rad, -pi to pi, within 2 ULP; zeros and infinities as in C."""
    if x != x or y != y:
        return _NAN
    if x == 0.0 != y:
        return math.copysign(2.0 * _QUARTER_PI, y)
    if y == 0.0:
        angle = 0.0
    elif x - x != 0.0 and y - y != 0.0:
        angle = _QUARTER_PI
    else:
        angle = _atan(abs(y / x))
    if math.copysign(1.0, x) < 0.0:
        angle = 4.0 * _QUARTER_PI - (angle - 2.0 * _AT_LOW[3])
    return math.copysign(angle, y)
