"""What stands around translated functions in C: what the compiler must keep to, records, arrays."""

from __future__ import annotations

from .program import Definitions

INCLUDES = """#include <float.h>
#include <stdbool.h>
#include <stdint.h>"""
# Refused where it can be seen while compiling; NAME_self_test() finds what cannot.
ARITHMETIC = """#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "compile without -ffast-math and -Ofast: the bits would differ"
#endif
#if defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "compile without -funsafe-math-optimizations: the bits would differ"
#endif
#if FLT_RADIX != 2 || DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "double must be IEEE 754's binary64"
#endif
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 1 && FLT_EVAL_METHOD != 16
#error "doubles are computed with more bits: compile with -msse2 -mfpmath=sse"
#endif
/* No multiplication and addition in one rounding. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif
#if defined(__GNUC__)
#define INFINITE __builtin_inf()
#define NOT_A_NUMBER __builtin_nan("")
#else
#include <math.h>
#define INFINITE ((double)INFINITY)
#define NOT_A_NUMBER ((double)NAN)
#endif"""
ARRAYS = """typedef struct {
    double *data;
    int64_t length;
} Reals;
typedef struct {
    double *data;
    int64_t rows, columns;
} RealRows;
typedef struct {
    int64_t *data;
    int64_t length;
} Integers;
typedef struct {
    int64_t *data;
    int64_t rows, columns;
} IntegerRows;"""


def library(program: Definitions, roots: str) -> str:
    """Return one C text: all records, and the functions that ``roots`` mentions."""
    structures = [program.structure(record) for record in program.records]
    body = program.text(roots)
    return "\n\n".join([INCLUDES, ARITHMETIC, ARRAYS, *structures, body]) + "\n"
