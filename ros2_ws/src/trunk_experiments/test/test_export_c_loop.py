"""The closed loop as C, and the contract: everything that the compiled loop reaches can be translated."""

from __future__ import annotations

import ctypes
import subprocess

import numpy as np
import pytest

from trunk_control.laws import law_named
from trunk_experiments.batch.compiled_run import ROWS, Batch, _noise, loop_of, start_of_loop
from trunk_experiments.batch.random_plans import random_plan
from trunk_experiments.errors import PlanError
from trunk_experiments.export_c.closed_loop import closed_loop
from trunk_experiments.export_c.translate import Program
from trunk_experiments.export_c.types import type_of
from trunk_experiments.plans.nodes import CONTROLLERS
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.loop_inputs import states_of
from trunk_experiments.runs.schedule import Schedule
from trunk_sim.links import DRAWS, Link, simulate_link
from trunk_sim.noise import fill

from .c_programs import COMPILER, STRICT, needs_compiler


def loop_and_arguments(plan):
    """Return a plan's loop, and its arguments as compiled code takes them."""
    states = states_of(plan)
    surroundings, state, participants = start_of_loop(plan)
    history = np.empty((plan.simulator.delay_steps + 1, 4))
    out = np.empty((ROWS, states))
    rest = (_noise(plan, states), history, Schedule(), out)
    loop = loop_of(*(law_named(name) for name in plan.controllers))
    return loop, (states, surroundings, state, participants, *rest)


def table_in_c(plan, folder):
    """Return the table of a plan's run as the loop in C fills it, and True if the plant diverged."""
    loop, arguments = loop_and_arguments(plan)
    program = closed_loop(loop, arguments)
    source, library = folder / "loop.c", folder / "loop.so"
    source.write_text(program.text)
    words = [COMPILER, *STRICT, "-O2", "-shared", "-fPIC", str(source), "-o", str(library)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    code = ctypes.CDLL(str(library))
    places = {}
    for path, array in program.arrays.items():
        function = getattr(code, array.function)
        function.restype = ctypes.c_void_p
        kind = ctypes.c_int64 if array.values.dtype == np.int64 else ctypes.c_double
        count = max(array.values.size, 1)
        places[path] = np.ctypeslib.as_array((kind * count).from_address(function()))
        if not array.inline and path != "out":
            places[path][:] = array.values.reshape(-1)
    code.trunk_loop_run.restype = ctypes.c_int64
    code.trunk_loop_diverged.restype = ctypes.c_bool
    count = code.trunk_loop_run()
    table = places["out"].reshape(ROWS, -1)[:, :count].copy()
    return table, bool(code.trunk_loop_diverged())


def compared(plan, folder):
    """Assert that a plan's run in C has the bits of the compiled run."""
    try:
        outcome = Batch().run(plan)
    except PlanError:  # such as references by topic
        return
    names = list(outcome.table.__dataclass_fields__)[1:]
    expected = np.array([getattr(outcome.table, name) for name in names])
    table, diverged = table_in_c(plan, folder)
    assert diverged == (outcome.diverged_at is not None)
    assert table.shape == expected.shape
    equal = (table.view(np.int64) == expected.view(np.int64)) | (
        np.isnan(table) & np.isnan(expected)
    )
    assert equal.all()


@needs_compiler
def test_fig8_has_the_same_bits_in_c(tmp_path):
    compared(make_plan("fig8", "fuzzy_pid"), tmp_path)


@needs_compiler
@pytest.mark.slow
@pytest.mark.one_in(20)
@pytest.mark.parametrize("index", range(40))
def test_random_plans_have_the_same_bits_in_c(index, tmp_path):
    compared(random_plan(index), tmp_path)


@pytest.mark.parametrize("names", [*((n,) for n in CONTROLLERS), CONTROLLERS], ids="+".join)
def test_everything_that_the_compiled_loop_reaches_can_be_translated(names):
    index = next(i for i in range(200) if tuple(random_plan(i).controllers) == tuple(names))
    loop, arguments = loop_and_arguments(random_plan(index))
    Program().function(loop, [type_of(argument) for argument in arguments])


def test_links_and_noise_can_be_translated():
    bits, whole = np.zeros((1, DRAWS), np.int64), np.zeros(2, np.int64)
    arguments = (0, bits, Link(), 1, whole, bits, whole, bits)
    Program().function(simulate_link, [type_of(argument) for argument in arguments])
    Program().function(fill, [type_of(argument) for argument in (whole, np.zeros(2))])
