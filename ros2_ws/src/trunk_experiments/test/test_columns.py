"""A record's columns: what is written into a lane's cells is read from them as it was."""

from __future__ import annotations

from collections import namedtuple
from math import nan

from hypothesis import given
from hypothesis import strategies as st

from trunk_experiments.batch.columns import LANES, in_common, reader_of, row_values, shared

FLOATS = st.floats(allow_nan=False)
LEAVES = FLOATS | st.integers() | st.booleans() | st.none() | st.tuples(FLOATS, FLOATS)


def named(parts):
    return namedtuple("Record", [f"part_{i}" for i in range(len(parts))])(*parts)


# A plain tuple has other parts than floats alone, which would be a table.
RECORDS = st.recursive(
    LEAVES,
    lambda parts: (
        st.lists(parts, min_size=1, max_size=12).map(named)
        | st.lists(parts, min_size=1, max_size=3).map(lambda some: (*some, None))
    ),
    max_leaves=30,
)


@given(st.lists(RECORDS, min_size=1, max_size=8).map(named), st.integers(0, 5), st.data())
def test_a_record_is_read_from_its_cells(record, row, data):
    lane = data.draw(st.integers(0, LANES - 1))
    values = row_values(record)
    cells = [nan] * ((row + len(values) + 1) * LANES)
    for i, value in enumerate(values):
        cells[(row + i) * LANES + lane] = value
    read, after = reader_of(record, row)
    assert after == row + len(values)
    found = read(cells, lane, record)
    assert found == record
    assert type(found) is type(record)
    # What has rows is read from them, whatever the others hold.
    zeros = read([0.0] * len(cells), lane, record)
    assert row_values(zeros) == [0.0] * len(values)
    assert in_common(zeros) == in_common(record)


def test_tables_are_arrays_and_false_is_none():
    found = shared(named([1.0, (2.0, 3.0), False, True]))
    assert found[1].tolist() == [2.0, 3.0]
    assert (found[0], found[2], found[3]) == (1.0, None, True)
