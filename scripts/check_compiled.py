#!/usr/bin/env python3
"""Step random runs by CPython and by compiled code and compare every number bit by bit.

scripts/check_compiled.py [RUNS]     default 1000; exit code 1 if a bit differs
"""

from __future__ import annotations

import sys

from trunk_experiments.batch.check import first_difference
from trunk_experiments.batch.compiled_run import Batch
from trunk_experiments.batch.random_plans import random_plan
from trunk_experiments.errors import PlanError


def main() -> int:
    text = sys.argv[1] if len(sys.argv) > 1 else "1000"
    if len(sys.argv) > 2 or not text.isdecimal() or text == "0":
        print(
            f"RUNS is {' '.join(sys.argv[1:])!r}: one whole number > 0 is needed", file=sys.stderr
        )
        return 2
    batch = Batch()
    diverged = refused = 0
    differences = []
    for index in range(int(text)):
        plan = random_plan(index)
        found = first_difference(plan, batch)
        try:
            diverged += batch.run(plan).diverged_at is not None
        except PlanError:
            refused += 1
        if found:
            differences.append(found)
            print(found)
    print(
        f"{text} random runs, {diverged} of them diverging, {refused} refused by both: "
        f"{len(differences)} differ"
    )
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
