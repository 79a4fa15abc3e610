import math
import random

import pytest

from ...trunk_core.test.c_programs import Compiled, needs_compiler
from .translatable import CALLS, Memory

pytestmark = needs_compiler
SPECIAL = (0.0, -0.0, math.nan, math.inf, -math.inf, 5e-324, 1e308, 0.5, 1.0, -1.0, 709.5)
WHOLE = (0, 1, -1, 2, 7, -7, 8, 2**53 + 1, -(2**53) - 3, 2**40)


def drawn(rng, example, small=False):
    """Return a random value of an example's type, often a special one."""
    if isinstance(example, bool):
        return rng.random() < 0.5
    if isinstance(example, int):
        return rng.choice(WHOLE) if rng.random() < 0.3 and not small else rng.randint(-20, 20)
    if isinstance(example, float):
        return rng.choice(SPECIAL) if rng.random() < 0.3 else rng.uniform(-3.0, 3.0)
    if hasattr(example, "_fields"):
        return type(example)(*(drawn(rng, item, small) for item in example))
    return tuple(drawn(rng, item, small) for item in example)


def differences(function, examples, count=400, **options):
    """Return the calls of a function whose results differ from CPython's."""
    rng = random.Random(function.__name__)
    small = function.__name__ in ("loops", "wide_integers")
    rows = [tuple(drawn(rng, example, small) for example in examples) for _ in range(count)]
    program = Compiled(function, examples, changing=(Memory,), **options)
    return program.different(rows, [function(*row) for row in rows])


@pytest.mark.parametrize("function", CALLS, ids=lambda f: f.__name__)
def test_bits_equal_to_those_of_cpython(function):
    assert differences(function, CALLS[function]) == []
