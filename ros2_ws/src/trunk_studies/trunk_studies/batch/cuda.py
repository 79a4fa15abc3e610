"""Kernels on a GPU, through CuPy, which compiles them and keeps on disk what it has compiled."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from trunk_core.errors import LibraryError, NotInstalledError
from trunk_evidence.run_metrics import MetricNumbers

from .kernel import FATES, Computed, Kernel, OnDevice, Words

# No multiplication and addition in one rounding; with more registers fewer threads run at a time.
OPTIONS = ("--fmad=false", "--std=c++17", "--maxrregcount=128")
BLOCK = 128  # threads
_SHARE = 0.5  # of the free memory: the threads' stacks need some, too
_NO_CARD = 100  # cudaErrorNoDevice
_USUAL_RATIO = 2  # of a card's floats to its doubles, computed in a second
CUPY = (
    "pip install -r requirements/cuda12.txt for a driver from 525 on; or cuda13.txt for one from 580 on and "
    "a card of compute capability 7.5 or more"
)


class CudaDevice:
    """The first card that CUDA shows. ``slow``: why it takes longer than others, empty if it does not.

    ``threads``: in a block. ``memory``: bytes for the words of runs; None: half of what is free.
    ``seconds``: for how long it has computed.

    Raises NotInstalledError without CuPy, LibraryError without a card that CuPy can use.
    """

    def __init__(self, threads: int = BLOCK, memory: int | None = None) -> None:
        self._threads, self._memory = threads, memory
        self.seconds = 0.0
        try:
            self._cupy: Any = import_module("cupy")
        except ImportError as error:
            if error.name == "cupy" and isinstance(error, ModuleNotFoundError):
                raise NotInstalledError(f"a GPU needs CuPy: {CUPY}") from None
            raise LibraryError(f"CuPy cannot be loaded ({_first_line(error)}): {CUPY}") from None
        runtime = self._cupy.cuda.runtime
        try:
            cards = runtime.getDeviceCount()
        except runtime.CUDARuntimeError as error:
            if error.status != _NO_CARD:
                problem = f"NVIDIA's driver is missing, or too old for this CuPy ({error})"
                raise LibraryError(f"{problem}: update the driver, or {CUPY}") from None
            cards = 0
        if cards == 0:
            raise LibraryError("no card of NVIDIA's is visible: leave --device cuda out")
        self.name: str = runtime.getDeviceProperties(0)["name"].decode()
        ratio = self._cupy.cuda.Device(0).attributes.get("SingleToDoublePrecisionPerfRatio", 0)
        self.slow = ""
        if ratio > _USUAL_RATIO:
            self.slow = f"{self.name} computes doubles at 1/{ratio} of the rate of floats"
            self.slow += (
                f", not at 1/{_USUAL_RATIO}: expect some {ratio // _USUAL_RATIO} times as long"
            )
        self.texts: dict[str, Any] = {}

    def run(self, kernel: Kernel, words: Words) -> Computed:
        """Return the outcomes of the runs that the words stand for; at a time as many as the memory holds."""
        function = self._function(kernel.text)
        try:
            return self._whole(function, words)
        except (MemoryError, RuntimeError) as error:
            again = "run the same command again; a sweep keeps its finished blocks"
            raise LibraryError(f"{self.name}: {_first_line(error)}: {again}") from None

    def _whole(self, function: Any, words: Words) -> Computed:
        count = len(MetricNumbers._fields)
        fates, metrics = np.empty((FATES, words.runs), np.int64), np.empty((count, words.runs))
        common = [self._cupy.asarray(array) for array in (words.rows, words.common, words.elements)]
        self._cupy.get_default_memory_pool().free_all_blocks()
        free, _ = self._cupy.cuda.runtime.memGetInfo()
        bytes_a_run = 8 * (len(words.own) + words.memory_size + len(fates) + count)
        longest = max((self._memory or int(_SHARE * free)) // bytes_a_run, self._threads)
        for first in range(0, words.runs, longest):
            runs = slice(first, min(first + longest, words.runs))
            fates[:, runs], metrics[:, runs] = self._part(function, words.part(runs), common)
        return Computed(fates[0], fates[1], fates[2], metrics)

    def _part(self, function: Any, words: Words, common: list[Any]) -> tuple[Any, Any]:
        rows, shared, elements = common
        own = self._cupy.asarray(words.own)
        memory = self._cupy.empty(words.runs * words.memory_size)
        fates = self._cupy.empty((FATES, words.runs), np.int64)
        metrics = self._cupy.empty((len(MetricNumbers._fields), words.runs))
        sizes = np.int64(words.runs), np.int64(words.memory_size)
        arrays = rows, shared, own, elements, memory, fates, metrics
        begun = time.perf_counter()
        function((-(-words.runs // self._threads),), (self._threads,), (*sizes, *arrays))
        self._cupy.cuda.Device().synchronize()
        self.seconds += time.perf_counter() - begun
        return fates.get(), metrics.get()

    def _function(self, text: str) -> Any:
        """Return a text's function, compiled. Raises LibraryError where CuPy finds no compiler."""
        if text not in self.texts:
            module = self._cupy.RawModule(code=text, options=OPTIONS)
            try:
                self.texts[text] = module.get_function("summarise_all")
            except Exception as error:  # CuPy's own are of no family
                raise LibraryError(f"CuPy cannot compile ({_first_line(error)}): {CUPY}") from None
        return self.texts[text]


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def on_cuda(warn: Callable[[str], None]) -> OnDevice:
    """Return the maker of runs on the first card; ``warn`` takes why it is slow. Raises as `CudaDevice`."""
    device = CudaDevice()
    if device.slow:
        warn(device.slow)
    return OnDevice(device)
