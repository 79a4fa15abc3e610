"""Kernels through CuPy: what stands for it here computes on the processor, and counts its memory."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from trunk_experiments.batch import cuda
from trunk_experiments.errors import LibraryError, NotInstalledError

from .cpp_device import COMPILER, CppDevice
from .test_kernel import DISTURBED, kernel_and_words, several

RUNS = 300


class CardError(RuntimeError):
    """An error of CUDA's runtime."""

    def __init__(self, status: int) -> None:
        super().__init__(f"error {status} of CUDA")
        self.status = status


class OnCard(np.ndarray):
    """An array of CuPy's."""

    def get(self):
        return np.asarray(self)


class Cupy:
    """What `CudaDevice` uses of CuPy: with so many cards, of such a ratio, with so much free memory."""

    def __init__(self, device=None, cards=1, ratio=2, free=10**9, fault="") -> None:
        self.launches, self.options = [], ()
        self._device, self._cards, self._free, self._fault = device, cards, free, fault
        runtime = SimpleNamespace(
            CUDARuntimeError=CardError,
            getDeviceCount=self._count,
            getDeviceProperties=lambda card: {"name": b"Some Card"},
            memGetInfo=lambda: (self._free, 2 * self._free),
        )
        attributes = {"SingleToDoublePrecisionPerfRatio": ratio}
        self.cuda = SimpleNamespace(
            runtime=runtime, Device=lambda card: SimpleNamespace(attributes=attributes)
        )

    def _count(self):
        if isinstance(self._cards, int):
            return self._cards
        raise self._cards

    def get_default_memory_pool(self):
        return SimpleNamespace(free_all_blocks=lambda: None)

    def asarray(self, array):
        return array.copy().view(OnCard)

    def empty(self, shape, dtype=np.float64):
        return np.empty(shape, dtype).view(OnCard)

    def RawModule(self, code, options):
        self.options = options
        return SimpleNamespace(get_function=lambda name: self._function(code, name))

    def _function(self, code, name):
        assert name == "summarise_all"
        if self._fault:
            raise RuntimeError(self._fault)

        def launch(grid, block, given):
            self.launches.append((*grid, *block))
            self._device.launch(code, *grid, *block, *given)

        return launch


@pytest.fixture
def cupy(monkeypatch, tmp_path):
    def made(**options):
        module = Cupy(CppDevice(tmp_path), **options)
        monkeypatch.setitem(sys.modules, "cupy", module)
        return module

    return made


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
@pytest.mark.slow
def test_what_does_not_fit_the_memory_goes_in_parts(cupy, tmp_path):
    kernel, words = kernel_and_words(several("pid", DISTURBED, count=RUNS, duration=0.05))
    module = cupy()
    device = cuda.CudaDevice()
    whole = device.run(kernel, words)
    assert module.launches == [(3, 128)]
    assert "--fmad=false" in module.options
    expected = CppDevice(tmp_path).run(kernel, words)
    small = cupy(free=100_000)
    parts = cuda.CudaDevice().run(kernel, words)
    assert len(small.launches) > 1
    for outcomes in (whole, parts):
        assert outcomes.metrics.tobytes() == expected.metrics.tobytes()
        assert outcomes.states.tolist() == expected.states.tolist()
        assert outcomes.fates.tolist() == expected.fates.tolist()


def test_without_cupy(monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(NotInstalledError, match="needs CuPy: pip install 'cupy-cuda12x"):
        cuda.CudaDevice()


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        (0, "no card of NVIDIA's is visible"),
        (CardError(100), "no card of NVIDIA's is visible"),
        (CardError(35), r"driver is missing, or too old .*\(error 35 of CUDA\): update"),
    ],
)
def test_without_a_card(cupy, cards, message):
    cupy(cards=cards)
    with pytest.raises(LibraryError, match=message):
        cuda.CudaDevice()


def test_without_a_compiler(cupy):
    cupy(fault="CuPy failed to load libnvrtc.so.12\nand says more")
    with pytest.raises(LibraryError, match=r"compile \(CuPy failed to load libnvrtc.so.12\): pip"):
        cuda.CudaDevice().run(SimpleNamespace(text=""), None)


@pytest.mark.parametrize(
    ("ratio", "slow"),
    [
        (2, ""),
        (
            64,
            "Some Card computes doubles at 1/64 of the rate of floats, not at 1/2: expect some 32 times",
        ),
    ],
)
def test_a_card_without_fast_doubles_is_named(cupy, ratio, slow):
    cupy(ratio=ratio)
    device = cuda.CudaDevice()
    assert device.slow.startswith(slow)
    assert bool(device.slow) == bool(slow)
