"""What a node may receive: parameters and messages, valid, extreme, wrong and damaged (Hypothesis)."""

from __future__ import annotations

import struct
from math import inf, nan, pi
from sys import float_info
from typing import Any

from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import Parameter

from trunk_msgs_util.parameters.declarations import Declaration
from trunk_msgs_util.samples import JointSample

EXTREME = (0.0, -0.0, 5e-324, 1e-200, 1e200, float_info.max, -1e200, -float_info.max)
BAD = (nan, inf, -inf)

ordinary = st.floats(-pi, pi)
numbers = ordinary | ordinary | st.sampled_from(EXTREME)
anything = st.one_of(numbers, numbers, numbers, st.sampled_from(BAD))


# Values of parameters.


def bounded(declaration: Declaration) -> st.SearchStrategy[Any]:
    """Return values that a declaration allows, its bounds among them."""
    low = declaration.minimum if declaration.minimum is not None else declaration.above
    high = declaration.maximum
    if declaration.choices:
        return st.sampled_from(declaration.choices)
    kind = declaration.kind.removesuffix(" array")
    if kind == "double":
        floats = st.floats(
            low,
            high,
            exclude_min=declaration.above is not None,
            allow_nan=False,
            allow_infinity=declaration.unbounded,
        )
        near = (declaration.default, 5e-324, 1e-300, low, high, 1.0, 7)
        ends = st.sampled_from([v for v in near if isinstance(v, int | float)])
        return floats | ends | ends
    if kind == "integer":
        return st.integers(int(low or 0), int(high or 2**31 - 1))
    if kind == "bool":
        return st.booleans()
    if declaration.name.startswith("rules."):
        labels = "S MS M B" if declaration.name == "rules.alpha" else "S B"
        row = st.lists(st.sampled_from(labels.split()), min_size=7, max_size=7).map(" ".join)
        return row | st.just(declaration.default[0])
    return st.sampled_from(["trunk", "hip", "", "X"])


WRONG = st.one_of(
    st.sampled_from(BAD),
    st.sampled_from(EXTREME),
    st.sampled_from([None, True, 2**63 - 1, -(2**63), "", "B B", "\u03b8", "x" * 100_000]),
    st.sampled_from([[], [nan], [True], [1, 2], ["a"] * 7, ["S " * 7] * 7, [0.5] * 20_000, [b"x"]]),
    st.lists(st.floats(), max_size=8),
)


def values(declaration: Declaration) -> st.SearchStrategy[Any]:
    """Return values for a parameter: most are allowed, the others of any kind."""
    right = bounded(declaration)
    if declaration.kind.endswith("array"):
        length = declaration.length
        right = st.lists(right, min_size=length or 0, max_size=length if length is not None else 4)
        if declaration.name.endswith(("peaks", "times")):
            right = right.map(sorted)
        right = right | st.just(list(declaration.default))
    return st.one_of(right, right, right, WRONG)


def message(name: str, value: Any) -> ParameterMessage:
    try:
        return Parameter(name, value=value).to_parameter_msg()
    except (TypeError, ValueError, AssertionError):  # a mixed list: ROS 2 cannot carry it
        return ParameterMessage(name=name, value=ParameterValue(type=200))


# Messages.

# Activate, deactivate, what is refused in every state, and numbers of no transition.
TRANSITIONS = st.sampled_from([3, 3, 4, 0, 1, 5, 99, 255])
STAMPS = st.sampled_from(
    ["next", "next", "next", "same", "back", "far", "last", "zero", "negative"]
)
NAMES = st.sampled_from(
    [("hip", "trunk")] * 6 + [("trunk", "hip"), ("trunk",), ("hip",), (), ("a", "trunk", "hip")]
)
SIZES = st.sampled_from(["right"] * 6 + ["none", "short", "huge"])
RAW = st.one_of(
    st.binary(max_size=80),
    st.sampled_from([b"", b"\x00", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + b"\xff" * 200]),
)
DAMAGE = st.sampled_from(["cut", "stamp", "flip", "tail", "big-endian"])


@st.composite
def quantities(draw: Any, count: int) -> tuple[float, ...]:
    size = draw(SIZES)
    if size == "huge":
        return (draw(anything),) * 50_000
    count = {"right": count, "none": 0, "short": max(count - 1, 0)}[size]
    return tuple(draw(st.lists(anything, min_size=count, max_size=count)))


@st.composite
def samples(draw: Any) -> JointSample:
    names = draw(NAMES)
    return JointSample(0, names, *(draw(quantities(len(names))) for _ in range(3)))


def damaged(data: bytes, how: str, at: int) -> bytes:
    at %= max(len(data), 1)
    if how == "cut":
        return data[:at]
    if how == "stamp":  # nanoseconds beyond a second push it past the largest stamp
        return data[:4] + struct.pack("<iI", 2**31 - 1, 2**32 - 1) + data[12:]
    if how == "flip":
        return data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :]
    if how == "tail":
        return data + b"\x00" * at
    return b"\x00\x00" + data[2:]
