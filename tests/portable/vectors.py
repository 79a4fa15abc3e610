"""Arguments and results of the elementary functions, and programs in C and JavaScript that check them.

A line of the file: a function's name, its argument, its result or results, as the 16 hexadecimal digits of
an IEEE 754 double.
"""

import math
import random
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

from trunk_core.elementary import LARGEST_ANGLE, exp, log, sincos

from .translate import JAVASCRIPT, C, translated

_C = """#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef struct { double a, b; } pair;
%s
static double number(const char *text) {
    uint64_t bits = strtoull(text, NULL, 16);
    double value;
    memcpy(&value, &bits, 8);
    return value;
}
static int differs(double found, const char *text) {
    double expected = number(text);
    return memcmp(&found, &expected, 8) != 0 && !(found != found && expected != expected);
}
int main(void) {
    char name[8], x[17], a[17], b[17];
    long count = 0, wrong = 0;
    while (scanf("%%7s %%16s %%16s %%16s", name, x, a, b) == 4) {
        double value = number(x);
        count++;
        if (name[0] == 's') {
            pair found = my_sincos(value);
            wrong += differs(found.a, a) || differs(found.b, b);
        } else {
            wrong += differs(name[0] == 'e' ? my_exp(value) : my_log(value), a);
        }
    }
    printf("%%ld of %%ld differ\\n", wrong, count);
    return wrong != 0 || count == 0;
}
"""

_JAVASCRIPT = """%s
const lines = require("fs").readFileSync(0, "utf8").trim().split("\\n");
const bits = new BigUint64Array(1), value = new Float64Array(bits.buffer);
const number = (text) => { bits[0] = BigInt("0x" + text); return value[0]; };
const differs = (found, text) => !Object.is(found, number(text));
let wrong = 0;
for (const line of lines) {
  const [name, x, a, b] = line.split(" ");
  if (name === "sincos") {
    const found = sincos(number(x));
    wrong += differs(found[0], a) || differs(found[1], b);
  } else {
    wrong += differs((name === "exp" ? exp : log)(number(x)), a);
  }
}
console.log(`${wrong} of ${lines.length} differ`);
process.exit(wrong !== 0 || lines.length === 0 ? 1 : 0);
"""

PROGRAMS = {"vectors.c": _C % translated(C), "vectors.js": _JAVASCRIPT % translated(JAVASCRIPT)}


def arguments(name: str, count: int) -> Iterator[float]:
    """Yield arguments over a function's whole domain and past its ends."""
    some = random.Random(name)
    yield from (0.0, -0.0, 5e-324, -1e-300, 1.0, -1.0, 1e300, math.inf, -math.inf, math.nan)
    for k in range(count - 10):
        # Powers of two: 10**x would be the C library's.
        size = math.ldexp(some.uniform(1, 2), some.randrange(-1000, 1000 if name == "log" else 20))
        yield {
            "sincos": (some.uniform(-10, 10), some.uniform(-LARGEST_ANGLE, LARGEST_ANGLE), size),
            "exp": (some.uniform(-720, 720), some.uniform(-1, 1), -min(size, 700.0)),
            "log": (some.uniform(0, 2), 1 + some.uniform(-1e-3, 1e-3), size),
        }[name][k % 3]


def lines(count: int) -> Iterator[str]:
    """Yield the file's lines, this many for each function."""
    for name, function in (("sincos", sincos), ("exp", exp), ("log", log)):
        for x in arguments(name, count):
            found = function(x)
            a, b = found if isinstance(found, tuple) else (found, 0.0)
            yield f"{name} {_digits(x)} {_digits(a)} {_digits(b)}\n"


def _digits(x: float) -> str:
    # One NaN for all: IEEE 754 leaves its bits open.
    return struct.pack(">d", math.nan if x != x else x).hex()


def write(folder: Path, count: int) -> None:
    """Write the vectors and the programs."""
    with (folder / "vectors.txt").open("w") as file:
        file.writelines(lines(count))
    for name, text in PROGRAMS.items():
        (folder / name).write_text(text)


if __name__ == "__main__":
    write(Path(sys.argv[1]), int(sys.argv[2]))
