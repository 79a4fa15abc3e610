"""The project's own sine, cosine, exponential and logarithm: within 1 ULP, with the same bits everywhere."""

from __future__ import annotations

import math
import random
import re
import shutil
import subprocess
from pathlib import Path

import mpmath
import numpy as np
import pytest

from trunk_msgs_util import elementary
from trunk_msgs_util.elementary import LARGEST_ANGLE, cos, exp, log, sin, sincos

POINTS = 4000  # of each sort
FUNCTIONS = {"sin": sin, "cos": cos, "exp": exp, "log": log}


def points(name):
    """Return arguments over the function's whole domain, most of them where errors are largest."""
    some = random.Random(name)
    many = range(POINTS)

    def magnitudes(low, high):
        return [some.choice((-1, 1)) * 10 ** some.uniform(low, high) for _ in many]

    if name == "exp":
        found = [some.uniform(-708, 709) for _ in many] + [some.uniform(-1, 1) for _ in many]
        return found + magnitudes(-300, 2)
    if name == "log":
        near = [1 + some.uniform(-1, 1) * 2.0 ** -some.randrange(1, 50) for _ in many]
        return near + [some.uniform(0, 2) for _ in many] + [abs(x) for x in magnitudes(-307, 308)]
    quarters = [some.randrange(1, 2**20) * (math.pi / 2) for _ in many]
    near = [k * (math.pi / 2) * (1 + d * 2.0**-52) for k in range(1, POINTS // 3) for d in (-1, 1)]
    return [some.uniform(-1e6, 1e6) for _ in many] + quarters + near + magnitudes(-300, 6)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_error_is_below_one_unit_in_the_last_place(name):
    true, ours = getattr(mpmath, name), FUNCTIONS[name]
    with mpmath.workprec(200):
        for x in points(name):
            expected = true(mpmath.mpf(x))
            unit = math.ulp(float(expected))
            assert abs(mpmath.mpf(ours(x)) - expected) < unit, x.hex()


@pytest.mark.parametrize(
    ("function", "x", "expected"),
    [
        (sin, 0.0, "0.0"),
        (sin, -0.0, "-0.0"),
        (sin, 5e-324, "5e-324"),
        (sin, -1e-300, "-1e-300"),
        (cos, 0.0, "1.0"),
        (cos, -0.0, "1.0"),
        (exp, 0.0, "1.0"),
        (exp, -0.0, "1.0"),
        (exp, -708.1, "0.0"),
        (exp, 709.1, "inf"),
        (log, 1.0, "0.0"),
        (log, 0.0, "nan"),
        (log, -1.0, "nan"),
        (log, 5e-324, "nan"),
        *((f, x, "nan") for f in FUNCTIONS.values() for x in (math.inf, -math.inf, math.nan)),
        *((f, x, "nan") for f in (sin, cos) for x in (LARGEST_ANGLE + 1, -1e300)),
    ],
)
def test_ends_signs_and_zeros(function, x, expected):
    assert repr(function(x)) == expected


def test_odd_and_even():
    for x in points("sin"):
        s, c = sincos(x)
        assert sincos(-x) == (-s, c)


def test_compiled_code_returns_the_same_bits():
    numba = pytest.importorskip("numba")
    numba.extending.register_jitable(sincos)
    for name, ours in FUNCTIONS.items():
        compiled = numba.njit(ours)
        found = [(ours(x).hex(), compiled(x).hex(), x.hex()) for x in points(name)]
        assert [one for one in found if one[0] != one[1]] == []


def as_javascript():
    """Return the functions in JavaScript: the same operations, by text."""
    source = Path(elementary.__file__).read_text()
    constants = re.findall(r"^(_?[A-Z]\w*|_\d\w*) = ([-\d.e+]+)", source, re.MULTILINE)
    lines = [f"const {name} = {value};" for name, value in constants]
    body = re.search(r"    n = float\(floor.*?(?=    quadrant)", source, re.DOTALL).group()
    body = re.sub(r"float\(floor\((.*?)\)\)", r"Math.floor(\1)", body)
    body = re.sub(r"y = (.*?) if (.*?) else (\w)", r"y = \2 ? \1 : \3", body)
    body = re.sub(r"\s*#.*", "", body)
    names = sorted(set(re.findall(r"^    (\w+) =", body, re.MULTILINE)))
    statements = re.sub(r"^    (.+)$", r"\1;", body, flags=re.MULTILINE)
    return "\n".join(
        [
            *lines,
            f"function sincos(x) {{ let {', '.join(names)};",
            statements,
            "return [n, s, co]; }",
        ]
    )


@pytest.mark.skipif(shutil.which("node") is None, reason="Node.js: for the same bits in JavaScript")
def test_javascript_returns_the_same_bits(tmp_path):
    arguments = np.array([x for x in points("sin") if abs(x) <= LARGEST_ANGLE])
    (tmp_path / "x.bin").write_bytes(arguments.tobytes())
    script = f"""{as_javascript()}
const fs = require("fs");
const x = new Float64Array(new Uint8Array(fs.readFileSync("x.bin")).buffer);
const out = new Float64Array(2 * x.length);
x.forEach((one, i) => {{
  const [n, s, co] = sincos(one);
  const turn = [[s, co], [co, -s], [-s, -co], [-co, s]][n - 4 * Math.floor(0.25 * n)];
  out.set(turn, 2 * i);
}});
fs.writeFileSync("out.bin", new Uint8Array(out.buffer));
"""
    subprocess.run(["node", "-e", script], cwd=tmp_path, check=True)
    found = np.fromfile(tmp_path / "out.bin").reshape(-1, 2)
    expected = np.array([sincos(x) for x in arguments.tolist()])
    assert found.tobytes() == expected.tobytes()
