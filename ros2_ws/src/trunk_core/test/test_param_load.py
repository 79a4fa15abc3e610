"""What `ros2 param load` sends for a value is read as that value again."""

from math import inf

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from trunk_core.parameters.declarations import Declaration, ParameterError, check
from trunk_core.parameters.to_si import meant

numbers = st.floats(allow_nan=False)


def declared(kind, default=0.0):
    return Declaration("x", default, kind, "", "", unbounded=True)


def sent(value):
    """Return what arrives of a value: rclpy.parameter.get_parameter_value, without the message."""
    text = str(value)
    read = yaml.safe_load(text)
    if isinstance(read, bool | int | float | str):
        return read
    alike = isinstance(read, list) and any(
        all(isinstance(item, kind) for item in read) for kind in (bool, int, float, str)
    )
    return read if alike else text


@given(numbers)
@example(inf)
@example(-inf)
@example(1e-5)
@example(-1e16)
@example(-0.0)
def test_a_double(value):
    assert repr(check(declared("double"), meant(declared("double"), sent(value), 0.0))) == repr(
        value
    )


@given(st.lists(numbers, max_size=5))
@example([1e-5, 0.5])
@example([inf, -inf])
@example([inf, 0.5])
@example([])
def test_an_array_of_doubles(values):
    array = declared("double array", ())
    assert repr(check(array, meant(array, sent(values), ()))) == repr(tuple(values))


@given(st.lists(st.integers(-(2**63), 2**63 - 1), max_size=5))
def test_an_array_of_integers(values):
    array = declared("integer array", ())
    assert check(array, meant(array, sent(values), ())) == tuple(values)


@pytest.mark.parametrize("text", ["", "demo", "6", "1.50", "1e3", "yes", "inf", "0x10", "~"])
def test_a_string_that_yaml_reads_as_something_else(text):
    string = declared("string", "")
    assert check(string, meant(string, sent(text), text)) == text


@pytest.mark.parametrize(("value", "present"), [(7, "6"), (True, "1"), (1.5, "a: ["), (1, "1.0")])
def test_a_value_of_another_type_is_refused_for_a_string(value, present):
    with pytest.raises(ParameterError, match="not allowed: string"):
        check(declared("string", ""), meant(declared("string", ""), value, present))


@pytest.mark.parametrize("text", ["nan", "much", "", "inf inf", "1_000", "٣", "[1.0]"])
def test_what_is_not_a_number_is_refused_as_sent(text):
    with pytest.raises(ParameterError) as caught:
        check(declared("double"), meant(declared("double"), text, 0.0))
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize("value", ["[1.0, a]", "1.0", "[[1.0]]", ["1.0", "a"]])
def test_what_is_not_an_array_of_numbers_is_refused(value):
    array = declared("double array", ())
    with pytest.raises(ParameterError, match="double array"):
        check(array, meant(array, value, ()))
