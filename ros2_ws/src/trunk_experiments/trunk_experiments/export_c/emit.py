"""What stands around translated functions in C: what the compiler must keep to, records, arrays."""

from __future__ import annotations

from .helpers import template
from .program import Definitions

INCLUDES = """#include <float.h>
#include <stdbool.h>
#include <stdint.h>"""
# Refused where it can be seen while compiling; NAME_self_test() finds what cannot.
ARITHMETIC = template("arithmetic.h")
ARRAYS = template("arrays.h")


def library(program: Definitions, roots: str) -> str:
    """Return one C text: all records, and the functions that ``roots`` mentions."""
    structures = [program.structure(record) for record in program.records]
    body = program.text(roots)
    return "\n\n".join([INCLUDES, ARITHMETIC, ARRAYS, *structures, body]) + "\n"
