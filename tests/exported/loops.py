"""The closed loop of a plan in C, compiled, and run beside the same loop in CPython."""

import ctypes
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from ros2_ws.src.trunk_core.test.c_programs import STRICT, compiled_once
from ros2_ws.src.trunk_runs.test.random_plans import random_plan

from trunk_control.laws import law_named
from trunk_core.arrays import Integers
from trunk_core.c.translate import Program
from trunk_core.c.types import at_run_time, type_of
from trunk_core.errors import PlanError
from trunk_experiments.lab.webassembly import with_value
from trunk_runs.loop import Schedule, check_compilable, states_of
from trunk_runs.plan import RunPlan
from trunk_studies.batch.compiled_run import ROWS, _noise, loop_of, start_of_loop

NAMES = ("states", "surroundings", "state", "participants", "noise", "history", "schedule", "out")


def loop_and_arguments(
    plan: RunPlan, stamp_ns: Integers | None = None
) -> tuple[Any, tuple[Any, ...]]:
    """Return a plan's loop, and its arguments as compiled code takes them."""
    states = states_of(plan)
    surroundings, state, participants = start_of_loop(plan)
    history = np.zeros((plan.simulator.delay_steps + 1, 4))
    out = np.zeros((ROWS, states))
    rest = (_noise(plan, states), history, Schedule(stamp_ns=stamp_ns), out)
    laws = (law_named(name) for name in plan.controllers)
    loop = loop_of(*laws, dynamics=plan.simulator.dynamics)
    return loop, (states, surroundings, state, participants, *rest)


def jittered_stamps(plan: RunPlan) -> Integers | None:
    """Return stamps as of a robot's clock, off by up to a tenth of a period, for every third random plan."""
    if plan.simulator.seed % 3:
        return None
    states, period_ns = states_of(plan), plan.simulator.period_ns
    off = np.random.default_rng(plan.simulator.seed).integers(0, period_ns // 5, states)
    return np.arange(states) * period_ns + off


def closed_loop(loop: Any, arguments: tuple[Any, ...]) -> str:
    """Return a loop as C with `trunk_loop_run`, which fills the table of `trunk_loop_out`."""
    program = Program()
    f = program.function(loop, [type_of(argument) for argument in arguments])
    pairs = zip(NAMES, arguments, strict=True)
    values = {name: value for name, value in pairs if at_run_time(type_of(value))}
    statics = [line for name in values for line in with_value(program, name, values[name])]
    gives = program.c_type(f.result)
    given = [f"&{name}" if isinstance(value, tuple) else name for name, value in values.items()]
    tail = "\n".join(
        [
            *statics,
            "static bool diverged;",
            "double *trunk_loop_out(void);",
            "double *trunk_loop_out(void) { return out_data; }",
            "bool trunk_loop_diverged(void);",
            "bool trunk_loop_diverged(void) { return diverged; }",
            "int64_t trunk_loop_run(void);",
            "int64_t trunk_loop_run(void) {",
            f"const {gives} next = {f.name}({', '.join(given)});",
            "diverged = next.item1;",
            "return next.item0; }",
        ]
    )
    return f"{program.library(tail)}\n{tail}\n"


def table_in_c(plan: RunPlan, folder: Path, stamp_ns: Integers | None = None) -> tuple[Any, bool]:
    """Return the table of a plan's run as the loop in C fills it, and True if the plant diverged."""
    loop, arguments = loop_and_arguments(plan, stamp_ns)
    source, library = folder / "loop.c", folder / "loop.so"
    source.write_text(closed_loop(loop, arguments))
    compiler = shutil.which("gcc") or shutil.which("clang") or "cc"
    assert compiled_once([compiler, *STRICT, "-O2", "-shared", "-fPIC", source], library) == ""
    code = ctypes.CDLL(str(library))
    code.trunk_loop_out.restype = ctypes.c_void_p
    code.trunk_loop_run.restype = ctypes.c_int64
    code.trunk_loop_diverged.restype = ctypes.c_bool
    states = code.trunk_loop_run()
    size = arguments[-1].size
    out = np.ctypeslib.as_array((ctypes.c_double * size).from_address(code.trunk_loop_out()))
    return out.reshape(ROWS, -1)[:, :states].copy(), bool(code.trunk_loop_diverged())


def compare(plan: RunPlan, folder: Path) -> bool:
    """Return whether a plan's run in C has the bits of CPython's."""
    stamp_ns = jittered_stamps(plan)
    loop, arguments = loop_and_arguments(plan, stamp_ns)
    states, expected_divergence, _ = loop(*arguments)
    expected = arguments[-1][:, :states]
    table, diverged = table_in_c(plan, folder, stamp_ns)
    if diverged != expected_divergence or table.shape != expected.shape:
        return False
    equal = table.view(np.int64) == expected.copy().view(np.int64)
    return bool((equal | (np.isnan(table) & np.isnan(expected))).all())


def plans_of_one_loop() -> Iterator[RunPlan]:
    """Yield random plans, without those that need more than the loop, such as references by topic."""
    for index in count():
        plan = random_plan(index)
        with suppress(PlanError):
            check_compilable(plan)
            yield plan


def differs(plan: RunPlan) -> bool:
    """Return whether a plan's run has other bits in C."""
    with tempfile.TemporaryDirectory(prefix="trunk-loop-") as place:
        return not compare(plan, Path(place))
