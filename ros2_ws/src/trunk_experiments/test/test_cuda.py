"""Kernels through CuPy: what stands for it here computes on the processor, and counts its memory."""

import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trunk_core.errors import LibraryError, NotInstalledError
from trunk_studies.batch import cuda
from trunk_studies.study import parse_study
from trunk_studies.sweep_execution import SweepJob, processes, run_block

from ...trunk_runs.test.random_plans import DISTURBED, several
from ...trunk_studies.test.cpp_device import COMPILER, CppDevice, kernel_and_words

RUNS = 300
STUDY = """
scenario: fig8
controllers: [pid, fuzzy_pid]
duration: 2.5
rate: 200
runs: 12
block: 10
set: {simulator.sensor.position_noise: 0.002}
vary:
  delay: {parameter: simulator.link.command.delay, values: [0.0, 0.02]}
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.3, high: 0.8}
  gain: {parameter: pid.gains.d, as: factor, distribution: choice, values: [1.0, 2000.0]}
  least: {parameter: fuzzy_pid.gains.p_min, distribution: uniform, low: 20.0, high: 70.0}
"""


class CardError(RuntimeError):
    """An error of CUDA's runtime."""

    def __init__(self, status: int) -> None:
        super().__init__(f"error {status} of CUDA")
        self.status = status


class CompileError(Exception):
    """CuPy's own, of no family."""


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
            runtime=runtime,
            Device=lambda card=0: SimpleNamespace(attributes=attributes, synchronize=lambda: None),
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
            raise CompileError(self._fault)

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
    with pytest.raises(NotInstalledError, match="needs CuPy: pip install -r requirements/cuda12"):
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


def test_a_broken_cupy(monkeypatch):
    def broken(name):
        raise ModuleNotFoundError("No module named 'cupy._core'", name="cupy._core")

    monkeypatch.setattr(cuda, "import_module", broken)
    with pytest.raises(
        LibraryError, match=r"cannot be loaded \(No module named 'cupy._core'\): pip"
    ):
        cuda.CudaDevice()


@pytest.mark.parametrize("call", ["asarray", "empty"])
def test_without_memory(cupy, monkeypatch, call):
    def full(*given):
        raise MemoryError("Out of memory allocating 9 bytes\nand more")

    kernel, words = kernel_and_words(several("pid", count=2, duration=0.05))
    monkeypatch.setattr(cupy(), call, full)
    with pytest.raises(
        LibraryError, match=r"^Some Card: Out of memory allocating 9 bytes: run the"
    ):
        cuda.CudaDevice().run(kernel, words)


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


@pytest.fixture
def in_a_cards_place(monkeypatch, tmp_path):
    """A processor makes the runs of ``--device cuda``."""
    device = CppDevice(tmp_path)
    monkeypatch.setattr(device, "slow", "the card is slow", raising=False)
    monkeypatch.setattr(cuda, "CudaDevice", lambda: device)
    return device


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
@pytest.mark.slow
def test_a_sweep_writes_the_same_file(in_a_cards_place, tmp_path, trunk):
    """Links, refused rows and metrics that only the CPU can judge among others; begun on the CPU, too."""
    study = tmp_path / "study.yaml"
    study.write_text(STUDY)
    files = [tmp_path / f"{name}.parquet" for name in ("lanes", "alone", "card", "resumed")]
    begun = SweepJob(parse_study(STUDY, str(study)), files[3])
    begun.start()
    for block, table in processes(1)(list(begun.waiting())[2:4]):
        begun.keep(block, table)
    trunk("sweep", study, "-o", files[0], "--jobs", 1)
    alone = SweepJob(begun.study, files[1])
    alone.start()
    alone.run(lambda blocks: ((b.index, one_by_one(b)) for b in blocks))
    alone.finish()
    for file in files[2:]:
        code, _, said = trunk("sweep", study, "-o", file, "--device", "cuda")
        assert code == 0
        assert "warning: the card is slow" in said
        assert re.search(
            r"warning: \d+ runs were made on the CPU: links with delays or losses", said
        )
    lanes, *others = (file.read_bytes() for file in files)
    assert others == [lanes] * 3
    statuses = set(pq.read_table(files[0])["status"].to_pylist())
    assert statuses == {"ok", "diverged", "refused"}
    assert len(in_a_cards_place.texts) == 2


def one_by_one(block):
    rows = len(block.columns["run"])
    parts = [
        replace(block, columns={name: [values[i]] for name, values in block.columns.items()})
        for i in range(rows)
    ]
    return pa.concat_tables([run_block(part) for part in parts])


@pytest.mark.one_in(4)
@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
@pytest.mark.slow
def test_limits_and_indices_are_the_same(in_a_cards_place, tmp_path, trunk):
    study = tmp_path / "study.yaml"
    study.write_text(re.sub(r"(?m)^  (delay|least).*\n", "", STUDY).replace("runs: 12", "runs: 4"))
    vary = "--vary", "disturbance.pulse.magnitude", "--from", 0, "--to", 3, "--points", 4
    for verb in (("limit", "--study", study, *vary), ("sweep", study, "--sobol", 4)):
        texts = [trunk(*verb, "--json", "--device", name)[:2] for name in ("cpu", "cuda")]
        assert texts[0] == texts[1]
        assert texts[0][0] == 0
    assert in_a_cards_place.texts


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sweep", "robustness", "-o", "x.parquet", "--jobs", 2), "leave out --jobs"),
        (
            ("sweep", "robustness", "-o", "x.parquet", "--scheduler", "tcp://x:1"),
            "leave out --scheduler",
        ),
        (("limit", "demo", "--push", "0.1", "--from", 1, "--to", 2), "for --study alone"),
        (("sweep", "robustness", "-o", "x.parquet"), "a GPU needs CuPy"),
    ],
)
def test_what_a_card_cannot_do_is_said_in_one_line(
    arguments, message, monkeypatch, tmp_path, trunk
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "cupy", None)
    code, out, said = trunk(*arguments, "--device", "cuda")
    assert (code, out) == (2, "")
    assert message in said
    assert len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())
