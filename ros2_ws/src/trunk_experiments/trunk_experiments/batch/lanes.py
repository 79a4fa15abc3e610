"""Many runs at a time as one loop over pure functions: a lane per run, the innermost loops over lanes.

LLVM turns the innermost loops into vector instructions, in which every lane does the very operations of
the scalar functions: the bits are those of `compiled_run`, however wide the vectors are.

The numbers of the runs are cells: one row per number, one column per run. The cells are one flat array whose
rows all have `LANES` numbers, so that a compiler sees that rows do not overlap. What is not a float (modes,
flags), and tuples of floats (rule tables), are the same in all lanes.

A lane handles only a run's regular course: one controller, always active, whose law always has an answer. A
lane that meets anything else (its plant diverges, its trunk falls and that ends the run, its law holds)
is marked as left, and `compiled_run` computes its run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import nan
from typing import Any, NamedTuple

import numpy as np

from trunk_control.law import Constants, Hip, Law, Lookup, Sample
from trunk_control.limits import Limits
from trunk_control.pid_family import PidState
from trunk_control.reference import ReferenceProfile, reference_at
from trunk_msgs_util.recording.joint_table import Floats
from trunk_msgs_util.units import seconds
from trunk_sim.disturbances import Disturbance, Signals, disturbance_at
from trunk_sim.plant import PlantState, rk4_step
from trunk_sim.step import Plant, SensorParameters, beyond_fall, finite, sense, torque_of, torque_on

from ..analysis.metrics import MetricNumbers, Sums, numbers_of, with_row
from ..runs.loop import reading_of
from .varied import Varied

LANES = 16
_NUMBERS = (float, Varied)

Reader = Callable[[Floats, int, Any], Any]


def row_values(record: Any) -> list[Any]:
    """Return the numbers of a record that have rows, in order; columns among them."""
    if type(record) in _NUMBERS:
        return [record]
    if not _has_rows(record):
        return []
    return [value for part in record for value in row_values(part)]


def in_common(record: Any) -> Any:
    """Return a record without the numbers that have rows: equal for runs that can share a block."""
    if type(record) in _NUMBERS:
        return float
    if not _has_rows(record):
        return record
    if not hasattr(record, "_fields") and Varied in map(type, record):
        raise TypeError("a table that differs between runs has no row")
    return type(record).__name__, *(in_common(part) for part in record)


def shared(record: Any) -> Any:
    """Return a record as compiled code takes it: its tables as arrays, its False flags as None (`pruned`)."""
    if _has_rows(record):
        parts = [shared(part) for part in record]
        return record._make(parts) if hasattr(record, "_fields") else tuple(parts)
    if record is False:
        return None
    return np.array(record, dtype=np.float64) if type(record) is tuple else record


def reader_of(record: Any, row: int) -> tuple[Reader, int]:
    """Return a function that makes such a record from the cells, and the row after its last.

    ``read(cells, lane, common)`` takes what has no row from ``common``, a record of the same structure.
    """
    if type(record) is float:

        def read_cell(cells: Floats, lane: int, common: Any) -> Any:
            return cells[row * LANES + lane]

        return read_cell, row + 1
    if not _has_rows(record):
        return _as_it_is, row
    readers: list[Reader] = []  # of tuples, which together are the record's parts
    index = 0
    while index < len(record):
        parts = record[index:]
        if count := _leading(parts, lambda part: type(part) is float):
            count, reader = _block_of(count, row)
            row += count
        elif count := _leading(parts, lambda part: type(part) is not float and not _has_rows(part)):
            reader = _taken(index, index + count)
        else:
            count = 1
            read_part, row = reader_of(parts[0], row)
            reader = _alone(read_part, index)
        readers.append(reader)
        index += count
    read_all = _one_after_another(readers)
    if not hasattr(record, "_fields"):
        return read_all, row
    kind = type(record)

    def read_record(cells: Floats, lane: int, common: Any) -> Any:
        return kind(*read_all(cells, lane, common))

    return read_record, row


def _has_rows(record: Any) -> bool:
    return hasattr(record, "_fields") or (
        type(record) is tuple and not all(type(part) is float for part in record)
    )


def _as_it_is(cells: Floats, lane: int, common: Any) -> Any:
    return common


def _taken(begin: int, end: int) -> Reader:
    """Return a function that takes some parts of ``common`` as they are."""

    def take(cells: Floats, lane: int, common: Any) -> Any:
        return common[begin:end]

    return take


def _leading(parts: Sequence[Any], fits: Callable[[Any], bool]) -> int:
    """Return how many of the first parts fit."""
    return next((i for i, part in enumerate(parts) if not fits(part)), len(parts))


def _block_of(count: int, row: int) -> tuple[int, Reader]:
    """Return how many cells, at most ``count``, a function reads at once as a tuple, and that function.

    numba takes some 0.05 s for each function, however short: four cells are one function, not eight.
    """
    if count >= 4:

        def read_four(cells: Floats, lane: int, common: Any) -> Any:
            at = row * LANES + lane
            return cells[at], cells[at + LANES], cells[at + 2 * LANES], cells[at + 3 * LANES]

        return 4, read_four
    if count >= 2:

        def read_two(cells: Floats, lane: int, common: Any) -> Any:
            at = row * LANES + lane
            return cells[at], cells[at + LANES]

        return 2, read_two

    def read_one(cells: Floats, lane: int, common: Any) -> Any:
        return (cells[row * LANES + lane],)

    return 1, read_one


def _alone(reader: Reader, index: int) -> Reader:
    """Return a function that reads one part of a record, as a tuple of one."""

    def read_part(cells: Floats, lane: int, common: Any) -> Any:
        return (reader(cells, lane, common[index]),)

    return read_part


def _one_after_another(readers: Sequence[Reader]) -> Reader:
    """Return a function that makes one tuple of those that the readers make."""
    if len(readers) == 1:
        return readers[0]
    half = len(readers) // 2
    left, right = _one_after_another(readers[:half]), _one_after_another(readers[half:])

    def read_both(cells: Floats, lane: int, common: Any) -> Any:
        return (*left(cells, lane, common), *right(cells, lane, common))

    return read_both


STATE = 0  # of the plant, 4
SEEN = 4  # the state that the sensors see, 4
ACTING = 8  # the disturbance, 4
NOISE = 12  # samples, 2
WANTED = 14  # the reference now
REFERENCE = 15  # that of the last update, whose sample the next four rows have
SAMPLE = 16  # measurement, rate, the hip's position and rate
MEMORY = 20  # of the law, 5: its state but for ``started``
TORQUE = 25
LEFT = 26  # 1.0 in a lane that has left the regular course
TOTAL_TORQUE = 27  # N m, on the trunk over a period
INPUTS = 28  # what a law's tables are looked up by, 2
FELL = 30  # 1.0 from the state on in which the trunk has fallen
SUMS = 31
PARAMETERS = SUMS + len(
    Sums._fields
)  # of the run, as many as it has; then the cell of a law's tables


def four(cells: Floats, row: int, lane: int) -> tuple[float, float, float, float]:
    """Return a lane's numbers in four rows."""
    at = row * LANES + lane
    return cells[at], cells[at + LANES], cells[at + 2 * LANES], cells[at + 3 * LANES]


def keep_four(numbers: tuple[float, ...], row: int, cells: Floats, lane: int) -> None:
    """Write a lane's four numbers into the rows from ``row`` on."""
    at = row * LANES + lane
    cells[at], cells[at + LANES] = numbers[0], numbers[1]
    cells[at + 2 * LANES], cells[at + 3 * LANES] = numbers[2], numbers[3]


def keep_memory(memory: PidState, cells: Floats, lane: int) -> None:
    """Write the law's state."""
    keep_four(memory[:4], MEMORY, cells, lane)
    cells[(MEMORY + 4) * LANES + lane] = memory.effort


def keep_sums(sums: Sums, cells: Floats, lane: int) -> None:
    """Write the sums."""
    keep_four(sums[:4], SUMS, cells, lane)
    keep_four(sums[4:8], SUMS + 4, cells, lane)
    keep_four(sums[8:12], SUMS + 8, cells, lane)
    keep_four(sums[12:16], SUMS + 12, cells, lane)
    cells[(SUMS + 16) * LANES + lane] = sums.steady_rows
    cells[(SUMS + 17) * LANES + lane] = sums.steady_sum
    cells[(SUMS + 18) * LANES + lane] = sums.steady_squares


def keep_metrics(metrics: MetricNumbers, cells: Floats, lane: int) -> None:
    """Write the metrics in place of the sums."""
    for row in range(len(metrics)):
        cells[(SUMS + row) * LANES + lane] = metrics[row]


def state_at(cells: Floats, row: int, lane: int) -> PlantState:
    """Return the plant's state in four rows."""
    return PlantState(*four(cells, row, lane))


def acting_at(cells: Floats, lane: int) -> Disturbance:
    """Return the disturbance."""
    return Disturbance(*four(cells, ACTING, lane))


def sample_at(cells: Floats, lane: int, dt: float) -> Sample:
    """Return the law's sample."""
    measurement, rate, hip, hip_rate = four(cells, SAMPLE, lane)
    return Sample(cells[REFERENCE * LANES + lane], measurement, rate, dt, Hip(hip, hip_rate))


def memory_at(cells: Floats, lane: int, started: bool) -> PidState:
    """Return the law's state."""
    effort = cells[(MEMORY + 4) * LANES + lane]
    return PidState(*four(cells, MEMORY, lane), effort, started)


def sums_at(cells: Floats, lane: int) -> Sums:
    """Return the sums so far."""
    return Sums(
        *four(cells, SUMS, lane),
        *four(cells, SUMS + 4, lane),
        *four(cells, SUMS + 8, lane),
        *four(cells, SUMS + 12, lane),
        cells[(SUMS + 16) * LANES + lane],
        cells[(SUMS + 17) * LANES + lane],
        cells[(SUMS + 18) * LANES + lane],
    )


TRACED = 6  # numbers of a lane and step in a trace: the plant's state, the reference, the torque


class Common(NamedTuple):
    """What all lanes have in common."""

    plant: Plant
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


def lanes_loop(law: Law, example: Common) -> Callable[..., None]:
    """Return the loop of a law over a block of lanes.

    ``loop(common, cells, series, history, trace)`` computes the runs whose parameters and initial states
    are in ``cells``, and leaves their metrics there, in place of the sums. ``history``
    [delay_steps + 1, 4 LANES] is for the sensors' delay; ``trace`` [states, TRACED, LANES] is filled unless
    it is empty. ``example`` gives the structure.
    """
    update = law.update
    read_plant, row = reader_of(example.plant, PARAMETERS)
    read_sensor, row = reader_of(example.sensor, row)
    read_law, row = reader_of(example.limits, row)
    read_constants, row = reader_of(example.constants, row)
    look_up, read_near = looked_up(law.lookup, read_constants, read_law, row)

    def loop(
        common: Common, cells: Floats, series: LaneSeries, history: Floats, trace: Floats
    ) -> None:
        c = common
        h = c.plant.period / c.substeps
        dt, started = c.first_dt, False
        for k in range(c.states):
            t = seconds(k * c.period_ns)
            look(k, c.delay_steps, cells, history)
            take(k, series.acting, ACTING, cells)
            take(k, series.noise, NOISE, cells)
            if k % c.update_every == 0:
                take(k, series.reference, WANTED, cells)
                for lane in range(LANES):
                    seen = sense(
                        state_at(cells, SEEN, lane),
                        acting_at(cells, lane),
                        cells[NOISE * LANES + lane],
                        cells[(NOISE + 1) * LANES + lane],
                        read_sensor(cells, lane, c.sensor),
                    )
                    reading = reading_of(0, seen, 0.0, c.hip, nan)
                    wanted = cells[WANTED * LANES + lane]
                    hip = reading.hip
                    motion = reading.position, reading.velocity, hip.position, hip.velocity
                    cells[REFERENCE * LANES + lane] = wanted
                    keep_four(motion, SAMPLE, cells, lane)
                look_up(c, cells, dt, started)
                for lane in range(LANES):
                    after, terms = update(
                        memory_at(cells, lane, started),
                        sample_at(cells, lane, dt),
                        read_near(cells, lane, c.constants),
                        read_law(cells, lane, c.limits),
                    )
                    keep_memory(after, cells, lane)
                    left = cells[LEFT * LANES + lane]
                    cells[LEFT * LANES + lane] = 1.0 if terms.held else left
                dt, started = c.dt, True
            for lane in range(LANES):
                plant = read_plant(cells, lane, c.plant)
                state = state_at(cells, STATE, lane)
                falls = beyond_fall(state, plant)
                fallen = cells[FELL * LANES + lane]
                cells[FELL * LANES + lane] = 1.0 if falls else fallen
                ends = not finite(state) or (c.fall_stop and falls)
                left = cells[LEFT * LANES + lane]
                cells[LEFT * LANES + lane] = 1.0 if ends else left
                before, command = cells[TORQUE * LANES + lane], cells[(MEMORY + 4) * LANES + lane]
                torque = torque_of(before, command, plant)
                cells[TORQUE * LANES + lane] = torque
                turning = torque_on(state, torque, acting_at(cells, lane), plant)
                cells[TOTAL_TORQUE * LANES + lane] = turning
                sums = with_row(
                    sums_at(cells, lane),
                    t,
                    state.theta,
                    cells[REFERENCE * LANES + lane],
                    torque,
                    c.steady_from,
                )
                keep_sums(sums, cells, lane)
            tell(k, cells, trace)
            if k == c.states - 1:
                for lane in range(LANES):
                    keep_metrics(numbers_of(sums_at(cells, lane), 0.0), cells, lane)
                return
            for _ in range(c.substeps):
                for lane in range(LANES):
                    acting = acting_at(cells, lane)
                    state = rk4_step(
                        state_at(cells, STATE, lane),
                        acting.hip_force,
                        cells[TOTAL_TORQUE * LANES + lane],
                        h,
                        read_plant(cells, lane, c.plant).body,
                    )
                    keep_four(state, STATE, cells, lane)

    loop.__name__ = loop.__qualname__ = f"lanes_{law.update.__module__}"
    return loop


def looked_up(
    lookup: Lookup | None, read_constants: Reader, read_law: Reader, row: int
) -> tuple[Callable[..., None], Reader]:
    """Return a function that writes the cells of a law's tables from ``row`` on, and a reader of constants.

    For a law without tables, the first does nothing.
    """
    if lookup is None:
        return _nothing, read_constants
    inputs, cell_of, near = lookup.inputs, lookup.cell, lookup.near
    read_cell, _ = reader_of(lookup.kind(*[0.0] * len(lookup.kind._fields)), row)

    def look_up(common: Common, cells: Floats, dt: float, started: bool) -> None:
        c = common
        left_their_cell = 0
        for lane in range(LANES):
            a, b = inputs(
                memory_at(cells, lane, started),
                sample_at(cells, lane, dt),
                read_law(cells, lane, c.limits),
            )
            inside = within(a, b, read_cell(cells, lane, none_in_common))
            cells[INPUTS * LANES + lane] = a
            cells[(INPUTS + 1) * LANES + lane] = b
            left_their_cell += 0 if inside else 1
        if left_their_cell:
            for lane in range(LANES):
                a, b = cells[INPUTS * LANES + lane], cells[(INPUTS + 1) * LANES + lane]
                if not within(a, b, read_cell(cells, lane, none_in_common)):
                    cell = cell_of(a, b, read_constants(cells, lane, c.constants))
                    for i in range(len(cell)):
                        cells[(row + i) * LANES + lane] = cell[i]

    def read_near(cells: Floats, lane: int, common: Any) -> Any:
        return near(read_cell(cells, lane, none_in_common), read_constants(cells, lane, common))

    none_in_common = tuple(0.0 for _ in lookup.kind._fields)
    return look_up, read_near


def within(a: float, b: float, cell: Any) -> bool:
    """Return True if the inputs are in a cell of a law's tables."""
    inside: bool = cell[0] <= a < cell[1] and cell[2] <= b < cell[3]
    return inside


def _nothing(common: Common, cells: Floats, dt: float, started: bool) -> None:
    pass


def look(k: int, delay_steps: int, cells: Floats, history: Floats) -> None:
    """Write the states that the sensors see in step k: those of some steps ago, at first the initial ones."""
    if delay_steps == 0:
        for i in range(4 * LANES):
            cells[SEEN * LANES + i] = cells[STATE * LANES + i]
        return
    now = k % len(history)
    then = max(k - delay_steps, 0) % len(history)
    for i in range(4 * LANES):
        history[now, i] = cells[STATE * LANES + i]
    for i in range(4 * LANES):
        cells[SEEN * LANES + i] = history[then, i]


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
            trace[k, i, lane] = cells[(STATE + i) * LANES + lane]
    for lane in range(LANES):
        trace[k, 4, lane] = cells[REFERENCE * LANES + lane]
        trace[k, 5, lane] = cells[TORQUE * LANES + lane]


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
