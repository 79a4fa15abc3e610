"""A record's columns: what is written into a lane's cells is read from them as it was."""

from collections import namedtuple
from math import nan

from hypothesis import given
from hypothesis import strategies as st

from trunk_studies.batch.lanes import (
    LANES,
    in_common,
    reader_of,
    row_values,
    rows_of,
    shared,
    without_row,
    writer_of,
)

OTHERS = st.sampled_from([3, True, False, None, (1.0, 2.0)])


def named(parts):
    return namedtuple("Record", [f"part_{i}" for i in range(len(parts))])(*parts)


def flat(runs):
    return [part for run in runs for part in run]


def records(parts):
    """Return named tuples of runs of numbers and of other parts, and plain tuples that are not tables."""
    runs = st.integers(1, 9).map(lambda count: [0.0] * count) | st.lists(parts, min_size=1)
    return st.lists(runs, min_size=1, max_size=4).map(flat).map(named) | st.lists(
        parts, min_size=1, max_size=3
    ).map(lambda some: (*some, None))


@given(
    st.lists(st.recursive(OTHERS, records, max_leaves=12), min_size=1).map(named),
    st.integers(0, 5),
    st.integers(0, LANES - 1),
)
def test_a_record_is_read_from_its_cells(record, row, lane):
    wanted = [1.0 + i for i in range(len(row_values(record)))]
    cells = [nan] * ((row + len(wanted) + 1) * LANES)
    for i, value in enumerate(wanted):
        cells[(row + i) * LANES + lane] = value
    read, after = reader_of(record, row)
    assert after == row + len(wanted)
    found = read(cells, lane, record)
    assert row_values(found) == wanted
    assert in_common(found) == in_common(record)


INTEGERS = st.integers(-(2**63), 2**63 - 1)
NUMBERS = st.floats(allow_nan=False) | st.booleans() | INTEGERS


def whole(parts):
    return st.lists(parts, min_size=1, max_size=5).map(named) | st.lists(parts).map(tuple)


@given(
    st.lists(st.recursive(NUMBERS, whole, max_leaves=12), min_size=1).map(named),
    st.integers(0, 5),
    st.integers(0, LANES - 1),
)
def test_a_whole_record_is_read_as_it_was_written(record, row, lane):
    held = row_values(record, whole=True)
    cells = [nan] * ((row + len(held)) * LANES)
    writer_of(record, row)(record, cells, lane)
    assert cells[row * LANES + lane :: LANES] == held
    assert sum(cell == cell for cell in cells) == len(held)
    read, after = reader_of(record, row, whole=True)
    assert repr(read(cells, lane, ())) == repr(record)
    assert after == row + len(held)
    assert list(rows_of(record)) == [
        len(row_values(record[:i], whole=True)) for i in range(len(record))
    ]
    assert without_row(record) == ""


def test_what_is_no_number_has_no_row():
    record = named([1.0, named([(2.0, None)])])
    assert without_row(record) == "memory.part_1.part_0.1 is None"


def test_tables_are_arrays_and_false_is_none():
    found = shared(named([1.0, (2.0, 3.0), False, True]))
    assert found[1].tolist() == [2.0, 3.0]
    assert (found[0], found[2], found[3]) == (1.0, None, True)
