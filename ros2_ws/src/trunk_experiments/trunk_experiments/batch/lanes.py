"""Many runs at a time as one loop over pure functions: a lane per run, the innermost loops over lanes.

LLVM turns the innermost loops into vector instructions, in which every lane does the very operations of
the scalar functions: the bits are those of `compiled_run`, however wide the vectors are.

A lane handles only a run's regular course: one controller, always active, whose law always has an answer. A
lane that meets anything else (its plant diverges, its trunk falls and that ends the run, its law holds)
is marked as left, and `compiled_run` computes its run.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import Any, NamedTuple

from trunk_control.law import Constants, Law, Lookup
from trunk_control.limits import Limits
from trunk_control.reference import ReferenceProfile, reference_at
from trunk_msgs_util.recording.joint_arrays import Floats
from trunk_msgs_util.units import seconds
from trunk_sim.disturbances import Signals, disturbance_at
from trunk_sim.plant import rk4_step
from trunk_sim.step import (
    Plant,
    SensorParameters,
    beyond_fall,
    finite,
    sense,
    torque_of,
    torque_on,
)

from ..analysis.sums import with_row
from ..runs.loop import reading_of
from .cells import (
    ACTING,
    INPUTS,
    LEFT,
    MEMORY,
    NOISE,
    PARAMETERS,
    REFERENCE,
    SAMPLE,
    SEEN,
    STATE,
    TORQUE,
    TOTAL_TORQUE,
    WANTED,
    acting_at,
    keep_four,
    keep_memory,
    keep_sums,
    memory_at,
    sample_at,
    state_at,
    sums_at,
)
from .columns import LANES, Reader, reader_of

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
    are in ``cells``, and leaves their sums there. ``history`` [delay_steps + 1, 4 LANES] is for the
    sensors' delay; ``trace`` [states, TRACED, LANES] is filled unless it is empty. ``example`` gives the
    structure.
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
                ends = not finite(state) or (c.fall_stop and beyond_fall(state, plant))
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
