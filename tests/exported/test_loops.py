"""The closed loop as C, and the contract: everything that the compiled loop reaches can be translated."""

import shutil

import numpy as np
import pytest
from ros2_ws.src.trunk_runs.test.random_plans import random_plan

from trunk_core.c.translate import Program
from trunk_core.c.types import type_of
from trunk_runs.nodes import CONTROLLERS
from trunk_sim.links import DRAWS, Link, simulate_link
from trunk_sim.noise import fill

from .loops import closed_loop, loop_and_arguments

needs_compiler = pytest.mark.skipif(
    not (shutil.which("gcc") or shutil.which("clang")), reason="no C compiler: apt-get install gcc"
)


@pytest.mark.parametrize("names", [*((n,) for n in CONTROLLERS), CONTROLLERS[:4]], ids="+".join)
def test_everything_that_the_compiled_loop_reaches_can_be_translated(names):
    index = next(i for i in range(300) if tuple(random_plan(i).controllers) == tuple(names))
    loop, arguments = loop_and_arguments(random_plan(index))
    Program().function(loop, [type_of(argument) for argument in arguments])


def test_links_and_noise_can_be_translated():
    bits, whole = np.zeros((1, DRAWS), np.int64), np.zeros(2, np.int64)
    arguments = (0, bits, Link(), 1, whole, bits, whole, bits)
    Program().function(simulate_link, [type_of(argument) for argument in arguments])
    Program().function(fill, [type_of(argument) for argument in (whole, np.zeros(2))])


def test_the_text_of_a_loop_has_nothing_of_memory_that_nobody_wrote(monkeypatch):
    texts = set()
    for number in (1.0, 2.0):
        monkeypatch.setattr(
            np, "empty", lambda shape, dtype=float, n=number: np.full(shape, n, dtype)
        )
        texts.add(closed_loop(*loop_and_arguments(random_plan(13))))
    assert len(texts) == 1
