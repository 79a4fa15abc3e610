"""A table over time: NumPy as the oracle of its lines, hand values at its rows, ends and jumps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.units import held, interpolated, latest

TIMES = (1_000, 3_000, 3_000, 4_000)
VALUES = (0.5, -0.5, 2.0, 1.0)
# The longest table that parameters allow ends at 1e6 s.
STAMP = st.integers(0, 10**15)


@pytest.mark.parametrize(
    ("t_ns", "line", "level"),
    [
        (0, 9.0, 9.0),  # before the first row
        (999, 9.0, 9.0),
        (1_000, 0.5, 0.5),
        (2_000, 0.0, 0.5),
        (2_500, -0.25, 0.5),
        (3_000, 2.0, 2.0),  # two rows of the same time: a jump
        (3_750, 1.25, 2.0),
        (4_000, 1.0, 1.0),
        (10**15, 1.0, 1.0),  # after the last row
    ],
)
def test_hand_values(t_ns, line, level):
    assert interpolated(t_ns, TIMES, VALUES, 9.0) == line
    assert held(t_ns, TIMES, VALUES, 9.0) == level


def test_a_line_is_evaluated_in_the_stated_order():
    first, last, share = 0.9, 0.1, 2 / 5
    found = interpolated(2, (0, 5), (first, last), 0.0)
    assert found == first + (last - first) * share
    assert found != first + (last - first) * 2 / 5  # another order, another last bit
    assert found != first * (1.0 - share) + last * share


def test_without_rows_the_value_before_the_first_applies():
    assert (interpolated(5, (), (), 0.25), held(5, (), (), 0.25)) == (0.25, 0.25)


@given(st.lists(STAMP, min_size=1, max_size=30, unique=True), st.data())
def test_lines_are_those_of_numpy(times, data):
    times.sort()
    value = st.floats(-1e3, 1e3)
    values = data.draw(st.lists(value, min_size=len(times), max_size=len(times)))
    for t_ns in (*data.draw(st.lists(STAMP, max_size=10)), *times, times[0] + 1, times[-1] + 1):
        found = interpolated(t_ns, times, values, values[0])
        assert found == pytest.approx(np.interp(t_ns, times, values), rel=1e-12, abs=1e-9)
        if t_ns in times:
            assert found == values[times.index(t_ns)]


@given(st.lists(st.integers(0, 50), max_size=30), st.integers(-1, 51))
def test_the_latest_row_is_the_last_that_a_walk_passes(times, t_ns):
    times.sort()
    passed = [i for i, time in enumerate(times) if time <= t_ns]
    assert latest(t_ns, times) == (passed[-1] if passed else -1)
    assert latest(t_ns, times) == np.searchsorted(times, t_ns, side="right") - 1
