"""Plants with one fault each, and the check that has to find it; each is the cart-pole but for the fault."""

import math
import random
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from trunk_sim.api import Plant, PlantConfig, PlantState, parameter, sincos
from trunk_sim.plants.cart_pole import PLANT, CartPole, CartPoleConfig, accelerations

HONEST = PLANT
USUAL = CartPoleConfig().constants
FAULTS: dict[str, tuple[str, Plant]] = {}
Both = tuple[float, float]


def planted(check: str) -> Any:
    """Return a decorator of accelerations that only this check has to find."""

    def plant_of(function: Any) -> Any:
        FAULTS[function.__name__] = check, replace(PLANT, accelerations=function)
        return function

    return plant_of


@dataclass(frozen=True)
class Unbounded(PlantConfig):
    """A parameter without bounds."""

    mass: float = parameter("plant.mass", 0.1, "Mass", unit="kg")
    constants = property(lambda self: USUAL)


@dataclass(frozen=True)
class Hidden(PlantConfig):
    """A field that the simulator has, too."""

    delay: float = parameter("plant.delay", 0.1, "Delay", unit="s", minimum=0.0, maximum=1.0)
    constants = property(lambda self: USUAL)


@dataclass(frozen=True)
class Misnamed(PlantConfig):
    """A parameter that the simulator has, too."""

    late: float = parameter("sensor.delay", 0.1, "Delay", unit="s", minimum=0.0, maximum=1.0)
    constants = property(lambda self: USUAL)


class Whole(NamedTuple):
    """Constants of which one is a whole number."""

    cart_mass: float = 2.0
    mass: float = 0.1
    length: float = 0.5
    gravity: int = 10
    friction: float = 0.0


@dataclass(frozen=True)
class WholeConfig(PlantConfig):
    """No parameters of its own."""

    constants = property(lambda self: Whole())


@dataclass(frozen=True)
class Weightless(PlantConfig):
    """A mass that is divided by and may be 0."""

    mass: float = parameter("plant.mass", 0.1, "Mass", unit="kg", minimum=0.0, maximum=1.0)
    constants = property(lambda self: USUAL._replace(mass=self.mass))


FAULTS["unbounded"] = "declared", replace(PLANT, config=Unbounded)
FAULTS["hidden"] = "declared", replace(PLANT, config=Hidden)
FAULTS["misnamed"] = "declared", replace(PLANT, config=Misnamed)
FAULTS["whole_constants"] = "types", replace(PLANT, config=WholeConfig)
FAULTS["weightless"] = "finite", replace(PLANT, config=Weightless)
FAULTS["whole_energy"] = "types", replace(PLANT, energy=lambda state, c: 0)
FAULTS["moves_at_rest"] = "rest", replace(PLANT, rest=PlantState(0.0, 0.0, 1.0, 0.0))
FAULTS["leans_at_rest"] = "rest", replace(PLANT, rest=PlantState(0.0, 0.1, 0.0, 0.0))


_CART, _POLE = PLANT.picture.frames
_BODY, _BAR, _MASS = PLANT.picture.visuals
for _name, _changes in {
    "frame_in_a_frame_to_come": {"frames": (_POLE, _CART)},
    "frame_twice": {"frames": (_CART, _POLE, _POLE)},
    "slides_by_an_angle": {"frames": (_CART._replace(slides=1), _POLE)},
    "turns_by_a_length": {"frames": (_CART, _POLE._replace(turns=0))},
    "third_coordinate": {"frames": (_CART, _POLE._replace(turns=2))},
    "frame_at_a_word": {"frames": (_CART._replace(at=("here", 0.0)), _POLE)},
    "in_no_frame": {"visuals": (_BODY._replace(frame="wagon"), _BAR, _MASS)},
    "visual_twice": {"visuals": (_BODY, _BAR, _BAR)},
    "no_role": {"visuals": (_BODY._replace(role="red"), _BAR, _MASS)},
    "no_bar": {"visuals": (_BODY, _MASS)},
    "unknown_parameter": {"visuals": (_BODY, _BAR._replace(size="plant.width"), _MASS)},
    "without_points": {"visuals": (_BODY._replace(points=()), _BAR, _MASS)},
    "infinite": {"visuals": (_BODY, _BAR._replace(size=math.inf), _MASS)},
    "still": {"frames": (_CART._replace(slides=-1), _POLE)},
    "slides_and_turns": {"frames": (_CART, _POLE._replace(slides=0))},
    "frame_with_a_dot": {"frames": (_CART, _POLE, _POLE._replace(name="plant.length"))},
    "visual_with_a_dot": {"visuals": (_BODY, _BAR, _MASS._replace(name="plant.length"))},
    "ends_where_it_turns": {"visuals": (_BODY, _BAR._replace(points=_BAR.points[::-1]), _MASS)},
}.items():
    FAULTS[f"picture_{_name}"] = (
        "picture",
        replace(PLANT, picture=PLANT.picture._replace(**_changes)),
    )


@planted("types")
def returns_a_list(state: PlantState, force: float, torque: float, c: CartPole) -> Any:
    return list(accelerations(state, force, torque, c))


@planted("types")
def returns_a_whole_number(state: PlantState, force: float, torque: float, c: CartPole) -> Any:
    return 0, accelerations(state, force, torque, c)[1]


@planted("source")
def draws(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, force + random.random(), torque, c)


CALLS: list[int] = []


@planted("source")
def remembers_calls(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    CALLS.append(1)
    return accelerations(state, force, torque, c)


@planted("pure")
def counts_calls(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    CALLS.append(1)
    return accelerations(state, force + len(CALLS), torque, c)


@planted("portable")
def by_the_machines_sine(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, force, torque + 0.0 * math.sin(state.theta), c)


@planted("finite")
def divides_by_the_angle(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, force, torque + 0.0 / state.theta, c)


@planted("finite")
def is_infinite_when_fast(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, force, torque if state.x_dot < 50.0 else math.inf, c)


@planted("forces")
def takes_the_square(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, force * abs(force), torque, c)


@planted("forces")
def couples_one_way(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    """The cart feels the torque with the wrong sign."""
    return (
        accelerations(state, force, -torque, c)[0],
        accelerations(state, force, torque, c)[1],
    )


@planted("forces")
def pulls_backwards(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, -force, -torque, c)


@planted("sign")
def leans_forwards(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    """The angle's sense is the other: a force forwards lowers it."""
    x, theta, x_dot, theta_dot = state
    mirrored = PlantState(x, -theta, x_dot, -theta_dot)
    x_ddot, theta_ddot = accelerations(mirrored, force, -torque, c)
    return x_ddot, -theta_ddot


@planted("energy")
def swings_the_wrong_way(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    sine, _ = sincos(state.theta)
    swing = 2.0 * c.mass * c.length * sine * state.theta_dot * state.theta_dot
    return accelerations(state, force + swing, torque, c)


@planted("energy")
def is_driven_by_friction(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    return accelerations(state, force + 0.1 * state.x_dot, torque, c)


@planted("energy")
def has_friction_with_the_wrong_sign(
    state: PlantState, force: float, torque: float, c: CartPole
) -> Both:
    """By default there is no friction."""
    return accelerations(state, force + 2.0 * c.friction * state.x_dot, torque, c)


@planted("energy")
def loses_more_by_friction_than_a_wrong_factor_gives(
    state: PlantState, force: float, torque: float, c: CartPole
) -> Both:
    """Friction does not hide what is lost one way and gained the other."""
    sine, _ = sincos(state.theta)
    swing = 0.1 * c.mass * c.length * sine * state.theta_dot * state.theta_dot
    return accelerations(state, force + swing - 5.0 * state.x_dot, torque, c)


@planted("energy")
def has_friction_and_another_with_the_wrong_sign(
    state: PlantState, force: float, torque: float, c: CartPole
) -> Both:
    """The other one is 0 by default."""
    push = 2.0 * c.friction * state.x_dot - 0.1 * state.x_dot
    return accelerations(state, force + push, torque, c)


@planted("linear")
def sticks(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    friction = 0.1 if state.x_dot > 0.0 else -0.1 if state.x_dot < 0.0 else 0.0
    return accelerations(state, force - friction, torque, c)


@planted("quick")
def is_slow(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    for _ in range(3000):
        force = force + 0.0
    return accelerations(state, force, torque, c)


def with_friction(state: PlantState, force: float, torque: float, c: CartPole) -> Both:
    """A cart that loses energy, as a plant may."""
    return accelerations(state, force - 0.1 * state.x_dot, torque, c)


LOSSY = replace(PLANT, accelerations=with_friction)
WITHOUT_ENERGY = replace(PLANT, energy=None)
