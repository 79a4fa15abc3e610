"""Times are exact as integers and correctly rounded as floats."""

from fractions import Fraction

from hypothesis import example, given
from hypothesis import strategies as st

from trunk_core.units import LAST_STAMP_NS, nanoseconds, period_ns, seconds, step_count

stamps = st.integers(0, LAST_STAMP_NS)


@given(stamps)
@example(3_000_000)  # times 1e-9 would be 0.0030000000000000005 s
def test_seconds_are_the_nearest_double(stamp_ns):
    assert seconds(stamp_ns) == float(Fraction(stamp_ns, 10**9))


@given(st.integers(0, 2**50))  # 13 days
def test_nanoseconds_undo_seconds(stamp_ns):
    assert nanoseconds(seconds(stamp_ns)) == stamp_ns


def test_steps_are_counted_in_whole_periods():
    assert period_ns(60.0) == 16_666_667
    assert step_count(10.0, 60.0) == 600
    assert step_count(0.3, 1000.0) == 300
