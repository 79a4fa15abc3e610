"""Runs computed one a thread, on a GPU or, as C++, on a processor: their loop and metrics as one text.

A text belongs to a law and to the types of the values in its loop. All numbers are data, lengths of arrays
too: a table of 64-bit words from which a thread builds its run's records.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import count
from string import Template
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trunk_control.decide import Output
from trunk_control.laws import law_named
from trunk_core.arrays import Floats, Integers
from trunk_core.c.program import template
from trunk_core.c.translate import Program, indented
from trunk_core.c.types import (
    BOOLEAN,
    INTEGER,
    REAL,
    Array,
    RecordType,
    TableType,
    Type,
    UntranslatableError,
    at_run_time,
    type_of,
)
from trunk_core.units import seconds
from trunk_evidence.run_metrics import (
    MAY_BE_UNDEFINED,
    SETTLING,
    Measured,
    MetricNumbers,
    no_rows,
    numbers_of,
    steady_from,
    with_rows,
)
from trunk_runs.loop import (
    DIVERGED,
    FELL,
    GOES_ON,
    Chain,
    Instant,
    LoopState,
    Schedule,
    Surroundings,
    check_compilable,
    segment_of,
    states_of,
)
from trunk_runs.plan import RunPlan
from trunk_sim.noise import standard_normal
from trunk_sim.step import Dynamics, Measurement, PlantConstants, noisy, torque_of

from .block import Lanes, Outcomes
from .compiled_run import start_of_loop
from .varied import Rows, Varied

CHUNK = 32  # states whose noise is drawn, and which are measured, at a time
_LONGEST_NS = 2**53  # below it a stamp in ns is one double
# What became of a run: it has metrics, it diverged, or only the CPU can say what is wrong with it.
SOUND, UNSTABLE, UNSOUND = range(3)
_THETA, _TORQUE, _REFERENCE, _FRESH = range(4)  # columns of a thread's table


class Start(NamedTuple):
    """All that a run depends on; for many runs each number that they do not share is a `Varied`."""

    states: int
    seed: int  # of the sensors' noise
    surroundings: Surroundings
    state: LoopState
    participants: Chain


def fitted(plan: RunPlan) -> tuple[Kernel, Start] | str:
    """Return the kernel and the start of a plan's runs, or in words why they cannot be computed by one."""
    simulator = plan.simulator
    if len(plan.controllers) != 1:
        return "several controllers"
    if plan.controller.active_times:
        return "a controller that acts in turns (active.times)"
    if simulator.network is not None:
        return "links with delays or losses"
    if states_of(plan) * simulator.period_ns >= _LONGEST_NS:
        return "a run of more than 104 days"
    start = start_of_run(plan)
    try:
        return kernel_of(plan, start), start
    except UntranslatableError as error:
        return f"{plan.controller_name}: {error}"


def start_of_run(plan: RunPlan) -> Start:
    """Return all that a plan's run depends on."""
    surroundings, state, participants = start_of_loop(plan)
    surroundings = surroundings._replace(wire=None)
    return Start(states_of(plan), plan.simulator.seed, surroundings, state, participants)


# The text -------------------------------------------------------------------------------------------------


def keep_measured(out: Floats, row: int, instant: Instant, plant: PlantConstants) -> None:
    """Write what the metrics need of a state into a row of ``out``."""
    out[row, _THETA] = instant.trunk.state.theta
    out[row, _TORQUE] = torque_of(instant.trunk.effort, instant.effort, plant)
    out[row, _REFERENCE] = instant.decision.reference
    out[row, _FRESH] = 1.0 if instant.decision.updated else 0.0


def write_nothing(out: Floats, row: int, answer: Output, measured: Measurement) -> None:
    """Write down nothing of an update."""


def draws_noise(start: Start) -> bool:
    """Return True if the sensors of a run are noisy."""
    return noisy(start.surroundings.sensor)


def begun() -> Measured:
    """Return the sums before a run's first state."""
    return Measured(no_rows(0.0), 0.0)


@dataclass(frozen=True)
class Kernel:
    """A text that defines ``summarise_all``, and the type of the `Start` that its words make up."""

    text: str
    start: RecordType


def kernel_of(plan: RunPlan, start: Start) -> Kernel:
    """Return the kernel of a plan's law and plant and of a start's types. Raises UntranslatableError."""
    kernel = _kernel(plan.controller_name, plan.simulator.dynamics, type_of(_example(start)))
    if isinstance(kernel, UntranslatableError):
        raise kernel
    return kernel


def templates() -> list[str]:
    """Return the parts of a text besides translated functions: head, noise, the work of a thread."""
    head, work = (template(name, __package__) for name in ("kernel_head.h", "kernel.h"))
    return [head, template("pcg64.h"), work]


@cache
def _kernel(name: str, dynamics: Dynamics, start: RecordType) -> Kernel | UntranslatableError:
    try:
        return _translated(name, dynamics, start)
    except UntranslatableError as error:
        return error


def _translated(name: str, dynamics: Dynamics, start: RecordType) -> Kernel:
    head, *parts = templates()
    program = Program()
    if any(isinstance(t, Array) for _, t in program.places(start.types[3], "")):
        raise UntranslatableError(name, 0, "memory", "it holds arrays", "hold numbers")
    heads = re.findall(r"(?m)^\w.*", "\n".join(parts))  # with all names outside of functions
    program.names |= set(re.findall(r"(?<!\$)\b\w+", " ".join(heads)))
    table, schedule = Array(REAL, 2), type_of(Schedule())
    law = segment_of(
        law_named(name),
        dynamics=dynamics,
        keep=keep_measured,
        tell=lambda law: write_nothing,
    )
    segment = program.function(
        law, [INTEGER, INTEGER, *start.types[2:], table, table, schedule, table]
    )
    measured = type_of(begun())
    columns = _THETA, _TORQUE, _REFERENCE, _FRESH
    of_rows = [measured, INTEGER, INTEGER, INTEGER, REAL, *(INTEGER for _ in columns), table]
    functions = {
        "noisy": program.function(draws_noise, [start]),
        "seconds": program.function(seconds, [INTEGER]),
        "steady_from": program.function(steady_from, [REAL]),
        "standard_normal": program.function(standard_normal, [INTEGER]),
        "begun": program.function(begun, []),
        "with_rows": program.function(with_rows, of_rows),
        "numbers_of": program.function(numbers_of, [type_of(begun().sums), REAL]),
        "segment": segment,
    }
    tail = Template("\n\n".join(parts)).substitute(
        {role: f.name for role, f in functions.items()},
        Start=program.c_type(start),
        reads="\n".join(indented(list(_reads(program, start)))),
        numbers=", ".join(f"numbers.{field}" for field in MetricNumbers._fields),
        metrics=len(MetricNumbers._fields),
        undefined=len(MAY_BE_UNDEFINED),
        settling=MetricNumbers._fields.index(SETTLING),
        columns=", ".join(map(str, columns)),
        chunk=CHUNK,
        goes_on=GOES_ON,
        fell=FELL,
        diverged=DIVERGED,
        sound=SOUND,
        unstable=UNSTABLE,
        unsound=UNSOUND,
    )
    text = f"{program.library(tail, head)}\n{tail}\n"
    # A function of its own, so that what a thread keeps for later takes no registers in the loop.
    text = re.sub(rf"(?m)^static (?=.* {segment.name}\()", "static __noinline__ ", text)
    return Kernel(re.sub(r"(?m)^static ", "static __device__ ", text), start)


def _reads(program: Program, start: RecordType) -> Iterator[str]:
    """Yield the lines that build a start from its words."""
    words = count()
    for place, t in program.places(start, "start"):
        word = f"integer_of(words, {next(words)}, run)"
        if isinstance(t, Array | TableType):
            data, constant = (f"{place}.data", "") if isinstance(t, Array) else (place, "const ")
            yield f"{data} = ({constant}{t.element.c} *)(words->elements + {word});"
            for length in _lengths(t):
                yield f"{place}.{length} = integer_of(words, {next(words)}, run);"
        elif t == REAL:
            yield f"{place} = {word.replace('integer', 'real')};"
        else:
            yield f"{place} = {word}{' != 0' if t == BOOLEAN else ''};"


def _lengths(t: Array | TableType) -> tuple[str, ...]:
    """Return the fields of an array's lengths in C."""
    if isinstance(t, TableType):
        return ()
    return ("length",) if t.dimensions == 1 else ("rows", "columns")


# The words ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Words:
    """What a kernel computes runs from: their numbers as 64-bit words, doubles by their bits.

    ``rows`` [places] says for each place of a start in which row of ``own`` [rows, runs] it is, -1 for a
    place that has the same word in all runs, in ``common`` [places]. An array has a word for its beginning
    among the ``elements``, and another for each length.
    """

    runs: int
    rows: NDArray[np.int32]
    common: Integers
    own: Integers
    elements: Integers
    memory_size: int  # numbers that a run's sensors remember, for their delay

    def part(self, runs: slice) -> Words:
        """Return the words of a part of the runs."""
        own = np.ascontiguousarray(self.own[:, runs])
        return replace(self, runs=len(range(self.runs)[runs]), own=own)


def words_of(kernel: Kernel, parts: Sequence[tuple[Start, int]]) -> Words:
    """Return the words of a kernel's runs: each start stands for so many of them, in this order."""
    elements = _Elements()
    counts = [runs for _, runs in parts]
    values = [list(_values(start, kernel.start, runs, elements)) for start, runs in parts]
    rows, common, own = list[int](), list[np.int64](), list[Integers]()
    for column in zip(*values, strict=True):
        words = _joined(column, counts)
        rows.append(-1 if len(words) == 1 else len(own))
        common.append(words[0])
        if len(words) > 1:
            own.append(words)
    delay = max(start.surroundings.delay_steps for start, _ in parts)
    return Words(
        sum(counts),
        np.array(rows, np.int32),
        np.array(common),
        np.array(own, np.int64).reshape(len(own), sum(counts)),
        elements.joined(),
        4 * (delay + 1) if delay > 0 else 0,
    )


def _plain(value: Any) -> Any:
    return value.values if isinstance(value, Varied) else value


def _example(value: Any) -> Any:
    """Return the values of the first run."""
    if isinstance(value, tuple):
        items = map(_example, value)
        return value._make(items) if hasattr(value, "_make") else tuple(items)
    if isinstance(value, np.ndarray) and value.dtype == object:
        return np.array([_example(item) for item in value.flat]).reshape(value.shape)
    return value.values[0].item() if isinstance(value, Varied) else value


def _values(value: Any, t: Type, runs: int, elements: _Elements) -> Iterator[Any]:
    """Yield the numbers of a value's words, or their columns, in the order of `_reads`."""
    if isinstance(t, RecordType):
        for item, inner in zip(value, t.types, strict=True):
            yield from _values(item, inner, runs, elements)
    elif isinstance(t, Array | TableType):
        array = np.asarray(value)
        yield elements.beginning(array, np.float64 if t.element == REAL else np.int64, runs)
        yield from array.shape[: len(_lengths(t))]
    elif at_run_time(t):
        yield value


def _joined(values: Sequence[Any], counts: Sequence[int]) -> Integers:
    """Return a place's word in each run, or the single word that all have."""
    differ = any(isinstance(value, Varied) for value in values)
    numbers = np.array([]) if differ else np.array(values)
    if differ:
        pairs = zip(map(_plain, values), counts, strict=True)
        numbers = np.concatenate([np.broadcast_to(value, runs) for value, runs in pairs])
    words = numbers.astype(numbers.dtype if numbers.dtype == np.float64 else np.int64)
    words = words.view(np.int64)
    if (words == words[0]).all():
        return words[:1]
    return words if differ else np.repeat(words, counts)


class _Elements:
    """The numbers in arrays, an array behind the other; those with the same numbers are stored once."""

    def __init__(self) -> None:
        self._parts: list[Integers] = [np.zeros(1, np.int64)]
        self._size = 1
        self._known: dict[bytes, int] = {}

    def beginning(self, array: NDArray[Any], kind: type[Any], runs: int) -> int | Varied:
        """Return the place where an array begins; of one that holds columns, the place in each run."""
        if array.dtype != object:
            words = np.ascontiguousarray(array, kind).reshape(-1).view(np.int64)
            key = words.tobytes()
            if key not in self._known:
                self._known[key] = self._append(words)
            return self._known[key]
        block = np.empty((runs, array.size), kind)
        for i, item in enumerate(array.flat):
            block[:, i] = _plain(item)
        begin = self._append(block.reshape(-1).view(np.int64))
        return Varied(begin + array.size * np.arange(runs))

    def _append(self, words: Integers) -> int:
        self._parts.append(words)
        self._size += len(words)
        return self._size - len(words)

    def joined(self) -> Integers:
        """Return all numbers as words."""
        return np.concatenate(self._parts)


# The runs -------------------------------------------------------------------------------------------------


class Computed(NamedTuple):
    """What became of runs: `SOUND`, `UNSTABLE` or `UNSOUND`, their states, whether they fell, their metrics.

    The metrics are an array [metrics, runs]. Of a run that is unstable, the first number is when it
    diverged, s; there are no others.
    """

    fates: Integers
    states: Integers
    fell: Integers
    metrics: Floats


FATES = len(Computed._fields) - 1  # integers of a run


class Device(Protocol):
    """What computes the runs of kernels."""

    def run(self, kernel: Kernel, words: Words) -> Computed:
        """Return the fates of the runs that the words stand for."""


class OnDevice:
    """Makes runs on a device; in lanes those that it cannot make, and those that only the CPU can judge.

    ``left``: how many it could not make, by the reason.
    """

    def __init__(self, device: Device) -> None:
        self._device, self._lanes = device, Lanes()
        self.left: Counter[str] = Counter()

    def remarks(self) -> list[str]:
        """Return a line for each reason why runs were made on the CPU."""
        return [f"{count} runs were made on the CPU: {why}" for why, count in self.left.items()]

    def prepared(self, plan: RunPlan) -> tuple[Any, Any]:
        """Return a plan's kernel and start; or why it has none, and what lanes need."""
        check_compilable(plan)
        fit = fitted(plan)
        return (fit, self._lanes.prepared(plan)) if isinstance(fit, str) else fit

    def finish(
        self,
        parts: Iterable[tuple[Rows, Any]],
        plan_at: Callable[[int], RunPlan],
        outcomes: Outcomes,
    ) -> None:
        """Make the runs of some parts, a kernel's all at once."""
        others: list[tuple[Rows, Any]] = []
        kernels: dict[Kernel, list[tuple[Rows, Start]]] = {}
        for rows, (kernel, prepared) in parts:
            if isinstance(kernel, str):
                self.left[kernel] += len(rows)
                others.append((rows, prepared))
            else:
                kernels.setdefault(kernel, []).append((rows, prepared))
        for kernel, starts in kernels.items():
            rows = np.concatenate([part for part, _ in starts])
            words = words_of(kernel, [(start, len(part)) for part, start in starts])
            fates, _, fell, metrics = self._device.run(kernel, words)
            outcomes.fell[rows] = fell  # of an unsound run, the CPU says it again
            outcomes.metrics[:, rows[fates == SOUND]] = metrics[:, fates == SOUND]
            outcomes.diverged_at[rows[fates == UNSTABLE]] = metrics[0, fates == UNSTABLE]
            others.append((rows[fates == UNSOUND], None))
        self._lanes.finish(others, plan_at, outcomes)
