"""Many runs at a time as one loop over pure functions: a lane per run, the innermost loops over lanes.

LLVM turns the innermost loops into vector instructions, in which every lane does the very operations of
the scalar functions: the bits are those of `compiled_run`, however wide the vectors are.

The numbers of the runs are cells: one row per number, one column per run. The cells are one flat array whose
rows all have `LANES` numbers, so that a compiler sees that rows do not overlap. Of a run's parameters, what
is not a float (modes, flags), and tuples of floats (rule tables), are the same in all lanes.

A lane handles only a run's regular course: one controller, always active, whose law always has an answer. A
lane that meets anything else (its plant diverges, its trunk falls and that ends the run, its law holds)
is marked as left, and `compiled_run` computes its run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate
from math import nan
from typing import Any, NamedTuple

import numpy as np

from trunk_control.law import Constants, Law, LawMemory, Limits, Lookup, Sample
from trunk_control.reference import ReferenceProfile, reference_at
from trunk_core.arrays import Floats
from trunk_core.text import shortened
from trunk_core.units import seconds
from trunk_evidence.run_metrics import Sums, no_rows, numbers_of, with_row
from trunk_runs.loop import reading_of
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.plant import PlantState, rk4_step
from trunk_sim.step import (
    Dynamics,
    PlantConstants,
    SensorParameters,
    beyond_fall,
    finite,
    sense,
    torque_of,
)

from .varied import Varied

LANES = 16
# How a number is read from its cells and written into them. An integer's halves are exact as doubles; by
# shifts, not by a mask, LLVM makes vectors of them.
_CELLS: dict[type[Any], tuple[str, list[str]]] = {
    float: ("{}", ["{}"]),
    bool: ("{} != 0.0", ["1.0 if {} else 0.0"]),
    int: ("(int({}) << 32) + int({})", ["{0} >> 32", "{0} - ({0} >> 32 << 32)"]),
}

Reader = Callable[[Floats, int, Any], Any]
Writer = Callable[[Any, Floats, int], None]


def row_values(record: Any, whole: bool = False) -> list[Any]:
    """Return what the rows of a record hold, in order; columns among them."""
    if type(record) is Varied:
        return [record]
    if _has_cells(record, whole):
        if type(record) is int:
            return [float(record >> 32), float(record - (record >> 32 << 32))]
        return [float(record)]
    if not _has_parts(record, whole):
        return []
    return [value for part in record for value in row_values(part, whole)]


def in_common(record: Any) -> Any:
    """Return a record without the numbers that have rows: equal for runs that can share a block."""
    if type(record) in (float, Varied):
        return float
    if not _has_parts(record, False):
        return record
    if not hasattr(record, "_fields") and Varied in map(type, record):
        raise TypeError("a table that differs between runs has no row")
    return type(record).__name__, *(in_common(part) for part in record)


def shared(record: Any) -> Any:
    """Return a record as compiled code takes it: its tables as arrays, its False flags as None.

    So a compiler removes their branches.
    """
    if _has_parts(record, False):
        parts = [shared(part) for part in record]
        return record._make(parts) if hasattr(record, "_fields") else tuple(parts)
    if record is False:
        return None
    return np.array(record, dtype=np.float64) if type(record) is tuple else record


def reader_of(record: Any, row: int, whole: bool = False) -> tuple[Reader, int]:
    """Return a function that makes such a record from the cells, and the row after its last.

    ``read(cells, lane, common)`` takes what has no row from ``common``, a record of the same structure: all
    but floats, and tables, which are tuples of floats. Of a ``whole`` record every number has a row.
    """
    kinds: list[type[Any]] = []
    text, after = _read(record, "common", row, whole, kinds)
    return _made("read(cells, lane, common)", f"return {text}", kinds), after


def writer_of(record: Any, row: int) -> Writer:
    """Return ``write(record, cells, lane)``, which writes such a record, a whole one, into its rows."""
    return _made("write(record, cells, lane)", "; ".join(_written(record, "record", row)) or "pass")


def rows_of(record: Any) -> Any:
    """Return the first row of each part of a whole record, in place of the part."""
    sizes = [len(row_values(part, whole=True)) for part in record]
    return record._make(accumulate(sizes[:-1], initial=0))


def numbers_in(record: Any) -> list[Any]:
    """Return the numbers of nested tuples, in order."""
    if isinstance(record, tuple):
        return [number for part in record for number in numbers_in(part)]
    return [record]


def made_of(record: Any, numbers: Iterator[Any]) -> Any:
    """Return nested tuples like these, of other numbers."""
    if not isinstance(record, tuple):
        return next(numbers)
    parts = [made_of(part, numbers) for part in record]
    return record._make(parts) if hasattr(record, "_make") else tuple(parts)


def without_row(record: Any, name: str = "memory") -> str:
    """Return the first part of a whole record that is not a number, in words; empty if all are."""
    if _has_cells(record, whole=True):
        return ""
    if not _has_parts(record, whole=True):
        return f"{name} is {shortened(repr(record))}"
    names = getattr(record, "_fields", range(len(record)))
    parts = zip(names, record, strict=True)
    return next(filter(None, (without_row(part, f"{name}.{field}") for field, part in parts)), "")


def _made(head: str, body: str, kinds: Sequence[type[Any]] = ()) -> Callable[..., Any]:
    """Return a function from its text: numba takes some 0.05 s for each function, however short."""
    names = ", ".join(f"kind_{i}" for i in range(len(kinds)))
    text = f"def make({names}):\n def {head}: {body}\n return {head.partition('(')[0]}"
    scope: dict[str, Any] = {"__name__": __name__}
    exec(compile(text, __file__, "exec"), scope)
    function: Callable[..., Any] = scope["make"](*kinds)
    return function


def _read(
    record: Any, common: str, row: int, whole: bool, kinds: list[type[Any]]
) -> tuple[str, int]:
    """Return the text of a record read from the cells, and the row after its last."""
    if _has_cells(record, whole):
        text, written = _CELLS[type(record)]
        after = row + len(written)
        return text.format(*map(_cell, range(row, after))), after
    if not _has_parts(record, whole):
        return common, row
    parts = []
    for i, part in enumerate(record):
        text, row = _read(part, f"{common}[{i}]", row, whole, kinds)
        parts.append(f"{text}, ")
    if not hasattr(record, "_fields"):
        return f"({''.join(parts)})", row
    kinds.append(type(record))
    return f"kind_{len(kinds) - 1}({''.join(parts)})", row


def _written(record: Any, path: str, row: int) -> Iterator[str]:
    """Yield the statements that write a whole record."""
    if _has_cells(record, whole=True):
        for i, value in enumerate(_CELLS[type(record)][1]):
            yield f"{_cell(row + i)} = {value.format(path)}"
        return
    for i, part in enumerate(record if _has_parts(record, whole=True) else ()):
        yield from _written(part, f"{path}[{i}]", row)
        row += len(row_values(part, whole=True))


def _cell(row: int) -> str:
    return f"cells[{row * LANES} + lane]"


def _has_cells(record: Any, whole: bool) -> bool:
    return type(record) in (_CELLS if whole else (float,))


def _has_parts(record: Any, whole: bool) -> bool:
    if type(record) is tuple:
        return whole or not all(type(part) is float for part in record)
    return hasattr(record, "_fields")


class Lane(NamedTuple):
    """What a lane keeps from step to step, besides its run's parameters."""

    state: PlantState
    seen: PlantState  # by the sensors
    acting: Disturbance
    noise: tuple[float, float]  # samples
    wanted: float  # rad, the reference now
    sample: Sample  # of the last update
    torque: float  # N m
    forces: tuple[float, float]  # N or N m, on both coordinates over a period
    left: bool  # the regular course
    fell: bool  # in this state or an earlier one
    inputs: tuple[float, float]  # by which a law's tables are looked up
    sums: Sums  # at last the metrics in their place
    memory: LawMemory


_LANE = Lane(
    state=PlantState(0.0, 0.0, 0.0, 0.0),
    seen=PlantState(0.0, 0.0, 0.0, 0.0),
    acting=Disturbance(),
    noise=(0.0, 0.0),
    wanted=0.0,
    sample=Sample(0.0, 0.0, 0.0, 0.0),
    torque=0.0,
    forces=(0.0, 0.0),
    left=False,
    fell=False,
    inputs=(0.0, 0.0),
    sums=no_rows(0.0),
    memory=(),  # each law's own
)
BEGINNING = np.array(row_values(_LANE, whole=True))  # of a lane, before the first step
ROWS = rows_of(_LANE)
keep_state = writer_of(_LANE.state, ROWS.state)
keep_sample = writer_of(_LANE.sample, ROWS.sample)
keep_left = writer_of(_LANE.left, ROWS.left)
keep_fell = writer_of(_LANE.fell, ROWS.fell)
keep_forces = writer_of(_LANE.forces, ROWS.forces)
keep_inputs = writer_of(_LANE.inputs, ROWS.inputs)
keep_sums = writer_of(_LANE.sums, ROWS.sums)
keep_metrics = writer_of(numbers_of(_LANE.sums, 0.0), ROWS.sums)

TRACED = 6  # numbers of a lane and step in a trace: the plant's state, the reference, the torque


class Common(NamedTuple):
    """What all lanes have in common."""

    plant: PlantConstants
    sensor: SensorParameters
    limits: Limits
    constants: Constants
    hip: int  # 0: the hip's motion, 1: the trunk's, -1: none
    states: int
    period_ns: int
    substeps: int
    fall_stop: bool
    delay_steps: int
    update_every: int  # steps
    first_dt: float  # s, of the controller's first update
    dt: float  # s, of all others
    steady_from: float  # s


class LaneSeries(NamedTuple):
    """The inputs of each step: [states, rows, lanes], one lane if all have the same; empty: none."""

    reference: Floats  # 1 row
    acting: Floats  # 4 rows
    noise: Floats  # 2 rows


def lanes_loop(law: Law, dynamics: Dynamics, example: Common) -> Callable[..., None]:
    """Return the loop of a law and a plant's equations over a block of lanes.

    ``loop(common, cells, series, history, trace)`` computes the runs whose parameters and initial states
    are in ``cells``, and leaves their metrics there, in place of the sums. ``history``
    [delay_steps + 1, 4 LANES] is for the sensors' delay; ``trace`` [states, TRACED, LANES] is filled unless
    it is empty. ``example`` gives the structure.
    """
    update, memory = law.update, law.memory
    forces, accelerations = dynamics
    read, row = reader_of(_LANE._replace(memory=memory), 0, whole=True)
    keep_memory = writer_of(memory, ROWS.memory)
    read_plant, row = reader_of(example.plant, row)
    read_sensor, row = reader_of(example.sensor, row)
    read_limits, row = reader_of(example.limits, row)
    read_constants, row = reader_of(example.constants, row)
    look_up, read_near = looked_up(law.lookup, read, read_constants, read_limits, row)

    def loop(
        common: Common, cells: Floats, series: LaneSeries, history: Floats, trace: Floats
    ) -> None:
        c = common
        h = c.plant.period / c.substeps
        dt = c.first_dt
        for k in range(c.states):
            t = seconds(k * c.period_ns)
            look(k, c.delay_steps, cells, history)
            take(k, series.acting, ROWS.acting, cells)
            take(k, series.noise, ROWS.noise, cells)
            if k % c.update_every == 0:
                take(k, series.reference, ROWS.wanted, cells)
                for lane in range(LANES):
                    here = read(cells, lane, ())
                    position_sample, velocity_sample = here.noise
                    sensor = read_sensor(cells, lane, c.sensor)
                    seen = sense(here.seen, here.acting, position_sample, velocity_sample, sensor)
                    reading = reading_of(0, seen, 0.0, c.hip, nan)
                    sample = Sample(
                        here.wanted, reading.position, reading.velocity, dt, reading.hip
                    )
                    keep_sample(sample, cells, lane)
                look_up(c, cells)
                for lane in range(LANES):
                    here = read(cells, lane, ())
                    after, terms = update(
                        here.memory,
                        here.sample,
                        read_near(cells, lane, c.constants),
                        read_limits(cells, lane, c.limits),
                    )
                    keep_memory(after, cells, lane)
                    keep_left(here.left or terms.held, cells, lane)
                dt = c.dt
            for lane in range(LANES):
                here = read(cells, lane, ())
                plant = read_plant(cells, lane, c.plant)
                falls = beyond_fall(here.state, plant)
                ends = not finite(here.state) or (c.fall_stop and falls)
                keep_fell(here.fell or falls, cells, lane)
                keep_left(here.left or ends, cells, lane)
                torque = torque_of(here.torque, here.memory.effort, plant)
                cells[ROWS.torque * LANES + lane] = torque
                pushed = forces(torque, here.acting, here.state, plant.actuator)
                keep_forces(pushed, cells, lane)
                theta, reference = here.state.theta, here.sample.reference
                sums = with_row(here.sums, t, theta, reference, torque, c.steady_from)
                keep_sums(sums, cells, lane)
            tell(k, cells, trace)
            if k == c.states - 1:
                for lane in range(LANES):
                    keep_metrics(numbers_of(read(cells, lane, ()).sums, 0.0), cells, lane)
                return
            for _ in range(c.substeps):
                for lane in range(LANES):
                    here = read(cells, lane, ())
                    constants = read_plant(cells, lane, c.plant).constants
                    first_force, second_force = here.forces
                    state = rk4_step(
                        here.state, first_force, second_force, h, constants, accelerations
                    )
                    keep_state(state, cells, lane)

    motion = f"{accelerations.__module__}_{accelerations.__name__}"
    name = f"lanes_{motion}_{law.update.__module__}"
    loop.__name__ = loop.__qualname__ = name
    return loop


def looked_up(
    lookup: Lookup | None, read: Reader, read_constants: Reader, read_limits: Reader, row: int
) -> tuple[Callable[[Common, Floats], None], Reader]:
    """Return a function that writes the cells of a law's tables from ``row`` on, and a reader of constants.

    For a law without tables, the first does nothing.
    """
    if lookup is None:
        return _nothing, read_constants
    inputs, cell_of, near = lookup.inputs, lookup.cell, lookup.near
    nowhere = lookup.kind(*[0.0] * len(lookup.kind._fields))
    read_cell, _ = reader_of(nowhere, row)
    keep_cell = writer_of(nowhere, row)

    def look_up(common: Common, cells: Floats) -> None:
        c = common
        left_their_cell = 0
        for lane in range(LANES):
            here = read(cells, lane, ())
            a, b = inputs(here.memory, here.sample, read_limits(cells, lane, c.limits))
            inside = within(a, b, read_cell(cells, lane, ()))
            keep_inputs((a, b), cells, lane)
            left_their_cell += 0 if inside else 1
        if left_their_cell:
            for lane in range(LANES):
                a, b = read(cells, lane, ()).inputs
                if not within(a, b, read_cell(cells, lane, ())):
                    cell = cell_of(a, b, read_constants(cells, lane, c.constants))
                    keep_cell(cell, cells, lane)

    def read_near(cells: Floats, lane: int, common: Any) -> Any:
        return near(read_cell(cells, lane, ()), read_constants(cells, lane, common))

    return look_up, read_near


def within(a: float, b: float, cell: Any) -> bool:
    """Return True if the inputs are in a cell of a law's tables."""
    inside: bool = cell[0] <= a < cell[1] and cell[2] <= b < cell[3]
    return inside


def _nothing(common: Common, cells: Floats) -> None:
    pass


def look(k: int, delay_steps: int, cells: Floats, history: Floats) -> None:
    """Write the states that the sensors see in step k: those of some steps ago, at first the initial ones."""
    if delay_steps == 0:
        for i in range(4 * LANES):
            cells[ROWS.seen * LANES + i] = cells[ROWS.state * LANES + i]
        return
    now = k % len(history)
    then = max(k - delay_steps, 0) % len(history)
    for i in range(4 * LANES):
        history[now, i] = cells[ROWS.state * LANES + i]
    for i in range(4 * LANES):
        cells[ROWS.seen * LANES + i] = history[then, i]


def take(k: int, series: Floats, row: int, cells: Floats) -> None:
    """Write what a series [states, rows, lanes] has for step k; nothing if it is empty."""
    if k >= len(series):
        return
    for offset in range(series.shape[1]):
        if series.shape[2] == 1:
            for lane in range(LANES):
                cells[(row + offset) * LANES + lane] = series[k, offset, 0]
        else:
            for lane in range(LANES):
                cells[(row + offset) * LANES + lane] = series[k, offset, lane]


def tell(k: int, cells: Floats, trace: Floats) -> None:
    """Write step k of a trace [states, TRACED, LANES]; nothing if it is empty."""
    if k >= len(trace):
        return
    for i in range(4):
        for lane in range(LANES):
            trace[k, i, lane] = cells[(ROWS.state + i) * LANES + lane]
    for lane in range(LANES):
        trace[k, 4, lane] = cells[ROWS.sample * LANES + lane]
        trace[k, 5, lane] = cells[ROWS.torque * LANES + lane]


def fill_references(profile: ReferenceProfile, period_ns: int, lane: int, out: Floats) -> None:
    """Write one lane of a series [states, 1, lanes] of references."""
    for k in range(len(out)):
        out[k, 0, lane] = reference_at(k * period_ns, profile)


def fill_disturbances(signals: Signals, period_ns: int, lane: int, out: Floats) -> None:
    """Write one lane of a series [states, 4, lanes] of disturbances."""
    for k in range(len(out)):
        acting = disturbance_at(k * period_ns, signals)
        for i in range(4):
            out[k, i, lane] = acting[i]
