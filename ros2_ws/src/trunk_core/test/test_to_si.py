import math
from dataclasses import dataclass

import pytest

from trunk_core.parameters.declarations import ParameterError, build, declarations, parameter
from trunk_core.parameters.to_si import to_si, written_with_units


@dataclass(frozen=True)
class Example:
    delay: float = parameter("delay", 0.0, "How late", unit="s", minimum=0.0)
    ratio: float = parameter("ratio", 1.0, "How much")
    steps: int = parameter("steps", 1, "How many")
    name: str = parameter("name", "a", "Which")
    names: tuple[str, ...] = parameter("names", (), "Some", element=str)
    pair: tuple[float, ...] = parameter("pair", (0.0, 1.0), "Two", unit="m, rad", length=2)
    times: tuple[float, ...] = parameter("times", (), "Some", unit="s", element=float)
    kind: str = parameter("kind", "push", "What is pushed", choices=("push", "twist"))
    size: float = parameter(
        "size", 0.0, "How hard", unit="N or N m", unit_by="kind",
        units=(("push", "N"), ("twist", "N m")),
    )  # fmt: skip


DECLARED = declarations(Example)


def test_numbers_with_units_are_in_si_units():
    values = {
        "delay": "100ms",
        "ratio": "50%",
        "pair": ["10 cm", "45 deg"],
        "times": [1, "500 ms", 2.5, "1 min"],
        "size": "2 kN",
    }
    found = to_si(DECLARED, values)
    assert found == {
        "delay": 0.1,
        "ratio": 0.5,
        "pair": [0.1, math.radians(45)],
        "times": [1, 0.5, 2.5, 60.0],
        "size": 2000.0,
    }
    assert written_with_units(DECLARED, values) == set(values)
    assert build(Example, found).times == (1.0, 0.5, 2.5, 60.0)


def test_everything_else_is_left_as_it_is():
    values = {
        "delay": 1,
        "steps": 4,
        "name": "5 m",
        "names": ["5 m", "3 s"],
        "times": [],
        "unknown": "5 kg",
    }
    assert to_si(DECLARED, values) == values
    assert not written_with_units(DECLARED, values)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"delay": "fast"}, "'fast' is not allowed: double"),
        ({"delay": "1"}, "'1' is not allowed: double"),
        ({"delay": ["1 s"]}, "['1 s'] is not allowed: double"),
        ({"steps": "4 s"}, "'4 s' is not allowed: integer"),
        ({"pair": "45deg"}, "'45deg' is not allowed: double array of 2"),
        ({"delay": "-1 ms"}, "-0.001 is not allowed: double, >= 0"),
        ({"delay": "5kg"}, "parameter 'delay': '5kg' is not allowed: it is a mass; a time in s"),
        ({"pair": [0, "5 m"]}, "'5 m' is not allowed: element 1: it is a length; an angle in rad"),
        ({"pair": ["5 deg", 0]}, "'5 deg' is not allowed: element 0: it is an angle; a length"),
        ({"size": "2 N m"}, "it is a torque; a force in N is needed"),
        ({"kind": "twist", "size": "2 N"}, "it is a force; a torque in N m is needed"),
        ({"size": "2 N m"}, "(kind chooses the unit)"),
        ({"kind": "pull", "size": "2 N m"}, "'pull' is not allowed: string, one of push, twist"),
        ({"kind": "pull", "size": "2 s"}, "a force in N or a torque in N m is needed"),
    ],
)
def test_a_mistake_names_parameter_value_and_what_is_allowed(values, says):
    with pytest.raises(ParameterError) as caught:
        build(Example, to_si(DECLARED, values))
    assert says in str(caught.value)


def test_what_a_node_gets_with_a_unit_says_who_reads_units():
    says = "only trunk reads units: give a plain number in s"
    with pytest.raises(ParameterError, match=says):
        build(Example, {"delay": "100ms"})
    with pytest.raises(ParameterError, match=says):
        build(Example, {"times": ["100ms"]})
    with pytest.raises(ParameterError, match=r"not allowed: double, >= 0$"):
        build(Example, {"delay": "fast"})
    with pytest.raises(ParameterError, match=r"not allowed: integer$"):
        build(Example, {"steps": "4 s"})
