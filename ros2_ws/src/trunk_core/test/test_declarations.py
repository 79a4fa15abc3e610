import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.parameters.declarations import (
    ParameterError,
    build,
    declarations,
    parameter,
    values_of,
)


@dataclass(frozen=True)
class Example:
    rate: float = parameter("rate", 200.0, "How often", unit="Hz", above=0.0, maximum=1e6)
    limit: float = parameter("limit", math.inf, "Not more", minimum=0.0, unbounded=True)
    steps: int = parameter("steps", 1, "Substeps", minimum=1, maximum=10)
    on: bool = parameter("on", False, "Whether", fixed=True)
    mode: str = parameter("mode", "a", "Which", choices=("a", "b"))
    pair: tuple[float, ...] = parameter("pair", (0.0, 1.0), "Two", length=2, maximum=5.0)
    names: tuple[str, ...] = parameter("names", (), "Some", element=str)
    derived: int = 7

    def __post_init__(self):
        if self.pair[0] > self.pair[1]:
            raise ParameterError("pair", self.pair, "ascending values")


def test_one_declaration_holds_everything():
    declared = declarations(Example)
    assert list(declared) == ["rate", "limit", "steps", "on", "mode", "pair", "names"]
    assert declared["rate"].allowed() == "double, > 0 and <= 1e+06"
    assert declared["pair"].allowed() == "double array of 2, each <= 5"
    assert declared["mode"].allowed() == "string, one of a, b"
    assert declared["names"].kind == "string array"


def test_values_round_trip():
    config = build(Example, {"rate": 50, "pair": [1, 2.5], "names": ["x"]})
    assert config == Example(rate=50.0, pair=(1.0, 2.5), names=("x",))
    assert isinstance(config.rate, float)
    assert all(isinstance(value, float) for value in config.pair)
    assert build(Example, values_of(config)) == config


@pytest.mark.parametrize(("name", "value"), [("rate", 10**400), ("pair", {1: 2, 3: 4})])
def test_what_no_yaml_of_ros_holds_is_refused(name, value):
    with pytest.raises(
        ParameterError, match=f"^parameter '{name}': .* is not allowed: double"
    ) as caught:
        build(Example, {name: value})
    assert len(str(caught.value)) < 300


def test_an_unknown_name_gives_the_nearest_known_one():
    with pytest.raises(ParameterError, match="did you mean 'rate'"):
        build(Example, {"rat": 1.0})


@given(st.floats(allow_nan=False, min_value=5e-324, max_value=1e6))
def test_every_double_in_bounds_is_kept_to_the_bit(value):
    assert values_of(build(Example, {"rate": value}))["rate"] == value
