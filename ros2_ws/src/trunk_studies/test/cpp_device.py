"""A processor in a GPU's place: a kernel's text compiled as C++, its threads one after another."""

import ctypes
import shutil
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from trunk_evidence.run_metrics import MetricNumbers, metrics_from
from trunk_runs.plan import RunPlan
from trunk_studies.batch.block import RunSummary
from trunk_studies.batch.kernel import (
    FATES,
    UNSOUND,
    UNSTABLE,
    Computed,
    Kernel,
    Words,
    kernel_of,
    start_of_run,
    words_of,
)

from ...trunk_core.test.c_programs import compiled_once

COMPILER = shutil.which("g++") or shutil.which("clang++")
FLAGS = ("-O2", "-ffp-contract=off", "-x", "c++", "-shared", "-fPIC", "-std=c++17")
# What stands for CUDA's words.
_BEFORE = """
#define __device__
#define __global__
#define __noinline__
struct Index { unsigned int x; };
static Index blockIdx, blockDim, threadIdx;
static inline double __longlong_as_double(long long bits) {
    double number;
    __builtin_memcpy(&number, &bits, sizeof number);
    return number;
}
"""
_BEHIND = """
extern "C" void launch(
    unsigned int grid, unsigned int block, int64_t runs, int64_t memory_size, const int32_t *rows,
    const int64_t *common, const int64_t *own, int64_t *elements, double *memory, int64_t *outcomes,
    double *metrics) {
    blockDim.x = block;
    for (blockIdx.x = 0; blockIdx.x < grid; blockIdx.x++) {
        for (threadIdx.x = 0; threadIdx.x < block; threadIdx.x++) {
            summarise_all(runs, memory_size, rows, common, own, elements, memory, outcomes, metrics);
        }
    }
}
"""


class CppDevice:
    """Computes the runs of kernels; each text is compiled once, into a folder."""

    def __init__(self, folder: Path, flags: Sequence[str] = FLAGS, block: int = 32) -> None:
        self._folder, self._flags, self._block = folder, flags, block
        self.texts: dict[str, ctypes.CDLL] = {}

    def run(self, kernel: Kernel, words: Words) -> Computed:
        """Return the outcomes of the runs that the words stand for."""
        runs = words.runs
        fates = np.full((FATES, runs), -1, np.int64)
        metrics = np.full((len(MetricNumbers._fields), runs), np.nan)
        memory = np.full(max(runs * words.memory_size, 1), np.nan)
        arrays = (words.rows, words.common, words.own, words.elements, memory, fates, metrics)
        grid = -(-runs // self._block)
        self.launch(kernel.text, grid, self._block, runs, words.memory_size, *arrays)
        return Computed(fates[0], fates[1], fates[2], metrics)

    def launch(self, text: str, grid: int, block: int, runs: int, size: int, *arrays: Any) -> None:
        """Run a text's threads: a grid of blocks."""
        if text not in self.texts:
            self.texts[text] = self._compiled(text)
        places = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
        numbers = (ctypes.c_int64(int(runs)), ctypes.c_int64(int(size)))
        self.texts[text].launch(grid, block, *numbers, *places)

    def _compiled(self, text: str) -> ctypes.CDLL:
        source = self._folder / f"{sha256(text.encode()).hexdigest()[:16]}.cpp"
        source.write_text(_BEFORE + text + _BEHIND)
        library = source.with_suffix(".so")
        assert compiled_once([str(COMPILER), *self._flags, source], library) == ""
        return ctypes.CDLL(str(library))


def kernel_and_words(plans: Sequence[RunPlan]) -> tuple[Kernel, Words]:
    """Return the kernel of plans that have the same, and the words of their runs."""
    starts = [start_of_run(plan) for plan in plans]
    (kernel,) = {kernel_of(plan, s) for plan, s in zip(plans, starts, strict=True)}
    return kernel, words_of(kernel, [(start, 1) for start in starts])


def summary_in(outcomes: Computed, run: int) -> RunSummary | None:
    """Return a run's outcome; None if it needs the CPU."""
    numbers = outcomes.metrics[:, run].tolist()
    if outcomes.fates[run] == UNSOUND:
        return None
    fell = bool(outcomes.fell[run])
    if outcomes.fates[run] == UNSTABLE:
        return RunSummary(None, numbers[0], fell=fell)
    return RunSummary(metrics_from(MetricNumbers(*numbers)), fell=fell)
