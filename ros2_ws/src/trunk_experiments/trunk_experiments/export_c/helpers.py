"""The few C functions that stand for operators and built-in functions of Python."""

from __future__ import annotations

HELPERS = {
    "NOT_A_NUMBER": "",
    "INFINITE": "",
    "is_finite": """static inline bool is_finite(double x) {
    return x - x == 0.0;
}""",
    "real_abs": """static inline double real_abs(double x) {
    return x < 0.0 ? -x : x + 0.0; /* + 0.0: of -0.0 too */
}""",
    "integer_abs": """static inline int64_t integer_abs(int64_t x) {
    return x < 0 ? -x : x;
}""",
    "real_min": """static inline double real_min(double a, double b) {
    return b < a ? b : a; /* Python's order: it decides for NaN */
}""",
    "real_max": """static inline double real_max(double a, double b) {
    return b > a ? b : a;
}""",
    "integer_min": """static inline int64_t integer_min(int64_t a, int64_t b) {
    return b < a ? b : a;
}""",
    "integer_max": """static inline int64_t integer_max(int64_t a, int64_t b) {
    return b > a ? b : a;
}""",
    "with_sign": """static inline double with_sign(double x, double sign) {
    const double size = real_abs(x);
    return sign < 0.0 || (sign == 0.0 && 1.0 / sign < 0.0) ? -size : size;
}""",
    "index_in": """static inline int64_t index_in(int64_t i, int64_t length) {
    return i < 0 ? i + length : i; /* Python counts negative ones from the end */
}""",
    "floor_div": """static inline int64_t floor_div(int64_t a, int64_t b) {
    if (b == 0) {
        return 0; /* Python raises */
    }
    const int64_t q = a / b;
    return a % b != 0 && (a < 0) != (b < 0) ? q - 1 : q;
}""",
    "floor_mod": """static inline int64_t floor_mod(int64_t a, int64_t b) {
    if (b == 0) {
        return 0; /* Python raises */
    }
    const int64_t r = a % b;
    return r != 0 && (r < 0) != (b < 0) ? r + b : r;
}""",
    "truncated": """static inline int64_t truncated(double x) {
    if (!(x > -0x1p63 && x < 0x1p63)) {
        return x > 0.0 ? INT64_MAX : INT64_MIN; /* Python's are longer, or it raises */
    }
    return (int64_t)x;
}""",
    "floor_of": """static inline int64_t floor_of(double x) {
    const int64_t i = truncated(x);
    return x < (double)i && i > INT64_MIN ? i - 1 : i;
}""",
    "ceiling_of": """static inline int64_t ceiling_of(double x) {
    const int64_t i = truncated(x);
    return x > (double)i && i < INT64_MAX ? i + 1 : i;
}""",
    "quotient": """static double quotient(int64_t a, int64_t b) {
    /* The double nearest to a / b, as Python's: both may have more bits than a double. */
    const int64_t exact = INT64_C(1) << 53;
    if (a >= -exact && a <= exact && b >= -exact && b <= exact) {
        return (double)a / (double)b;
    }
    const uint64_t n = a < 0 ? 0u - (uint64_t)a : (uint64_t)a;
    const uint64_t d = b < 0 ? 0u - (uint64_t)b : (uint64_t)b;
    if (n == 0 || d == 0) {
        return (double)a / (double)b; /* for b = 0 Python raises */
    }
    uint64_t bits = n / d, rest = n % d;
    double scale = 2.0;
    while (bits < UINT64_C(1) << 53) { /* 53 bits, and one to round */
        const bool carry = rest >= d - rest;
        rest = carry ? rest - (d - rest) : rest + rest;
        bits = bits + bits + (carry ? 1u : 0u);
        scale *= 0.5;
    }
    while (bits >= UINT64_C(1) << 54) {
        rest |= bits & 1u;
        bits >>= 1;
        scale *= 2.0;
    }
    const bool up = (bits & 1u) != 0 && (rest != 0 || (bits & 2u) != 0);
    const double size = (double)((bits >> 1) + (up ? 1u : 0u)) * scale;
    return (a < 0) != (b < 0) ? -size : size;
}""",
    "square_root": """static double square_root(double x) {
    /* Correctly rounded, bit by bit: the same as IEEE 754's, without a library. */
    if (!(x > 0.0) || !is_finite(x)) {
        return x == 0.0 || x > 0.0 ? x : NOT_A_NUMBER;
    }
    double scale = 0x1p-52;
    for (; x < 0x1p-54; x *= 0x1p+54) {
        scale *= 0x1p-27;
    }
    for (; x < 1.0; x *= 4.0) {
        scale *= 0.5;
    }
    for (; x >= 0x1p+54; x *= 0x1p-54) {
        scale *= 0x1p+27;
    }
    for (; x >= 4.0; x *= 0.25) {
        scale *= 2.0;
    }
    uint64_t m = (uint64_t)(x * 0x1p+52), rest = 0, root = 0; /* m: 53 or 54 bits */
    for (int i = 0; i < 54; i++) {
        rest = (rest << 2) | ((m >> 52) & 3u);
        m <<= 2;
        const uint64_t next = (root << 2) | 1u;
        root <<= 1;
        if (rest >= next) {
            rest -= next;
            root |= 1u;
        }
    }
    return (double)((root >> 1) + (root & 1u)) * scale;
}""",
}
_CALLS = {
    "with_sign": ["real_abs"],
    "floor_of": ["truncated"],
    "ceiling_of": ["truncated"],
    "square_root": ["is_finite"],
}


def needed(words: set[str]) -> list[str]:
    """Return the helpers that a text with these words calls, each behind those that it calls."""
    wanted = set(words)
    for name, calls in _CALLS.items():
        if name in wanted:
            wanted |= set(calls)
    return [text for name, text in HELPERS.items() if name in wanted and text]
