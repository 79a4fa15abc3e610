"""A pole on a cart, the balance system of Astrom and Murray, *Feedback Systems*, with J = 0 and gamma = 0.

::

    (M + m) x'' - m l cos(th) th'' + c x' + m l sin(th) th'^2 = F
    -m l cos(th) x'' + m l^2 th'' - m g l sin(th)             = tau

th is measured from the upright, positive against the direction of x: a force forwards raises it.
"""

from dataclasses import dataclass
from math import pi
from typing import NamedTuple

from trunk_sim.api import (
    BASE,
    BODY,
    Coordinate,
    Frame,
    Picture,
    Plant,
    PlantConfig,
    PlantState,
    Track,
    Visual,
    cos,
    parameter,
    sincos,
)


class CartPole(NamedTuple):
    """The constants, SI units."""

    cart_mass: float
    mass: float
    length: float
    gravity: float
    friction: float


@dataclass(frozen=True)
class CartPoleConfig(PlantConfig):
    """Parameters of cart and pole, whose bounds keep what is divided by away from 0."""

    cart_mass: float = parameter(
        "plant.cart_mass", 2.0, "Mass M of the cart", unit="kg", minimum=1e-6, maximum=1e6
    )
    mass: float = parameter(
        "plant.mass", 0.1, "Mass m at the pole's end", unit="kg", minimum=1e-6, maximum=1e6
    )
    length: float = parameter(
        "plant.length", 0.5, "Length l of the pole", unit="m", minimum=1e-6, maximum=1e3
    )
    gravity: float = parameter(
        "plant.gravity", 9.81, "Gravity g", unit="m/s^2", minimum=0.0, maximum=1e3
    )
    friction: float = parameter(
        "plant.friction",
        0.0,
        "Viscous friction c of the cart",
        unit="N s/m",
        minimum=0.0,
        maximum=1e6,
    )

    @property
    def constants(self) -> CartPole:
        """What the functions below take."""
        return CartPole(self.cart_mass, self.mass, self.length, self.gravity, self.friction)


def accelerations(
    state: PlantState, force: float, torque: float, c: CartPole
) -> tuple[float, float]:
    """Return ``(x'', th'')`` in m/s^2 and rad/s^2 under F [N] on the cart and tau [N m] on the pole."""
    sin_theta, cos_theta = sincos(state.theta)
    swing = c.mass * c.length * sin_theta * state.theta_dot * state.theta_dot
    pull = force - c.friction * state.x_dot - swing
    turn = c.gravity * sin_theta + torque / (c.mass * c.length)
    inertia = c.cart_mass + c.mass * sin_theta * sin_theta
    x_ddot = (pull + c.mass * cos_theta * turn) / inertia
    return x_ddot, ((c.cart_mass + c.mass) * turn + cos_theta * pull) / (c.length * inertia)


def energy(state: PlantState, c: CartPole) -> float:
    """Return the mechanical energy in J, of which friction alone takes some."""
    v, swing = state.x_dot, c.length * state.theta_dot
    kinetic = 0.5 * (c.cart_mass + c.mass) * v * v + 0.5 * c.mass * swing * swing
    cross = c.mass * v * swing * cos(state.theta)
    return kinetic - cross + c.mass * c.gravity * c.length * cos(state.theta)


_END = (0.0, "plant.length")
PICTURE = Picture(
    (Frame("cart", slides=0), Frame("pole", on="cart", turns=1, sense=-1.0)),
    (
        Visual("cart", "cart", ((-0.15, 0.0), (0.15, 0.0)), 0.12, BASE),
        Visual("pole", "pole", ((0.0, 0.0), _END), 0.04, BODY),
        Visual("mass", "pole", (_END,), 0.1, BODY),
    ),
    Track(),
)
PLANT = Plant(
    "cart_pole",
    "Cart-pole",
    CartPoleConfig,
    (Coordinate("cart", "m"), Coordinate("pole", "rad")),
    accelerations,
    PICTURE,
    drive=0,
    start=PlantState(0.0, pi / 18.0, 0.0, 0.0),
    energy=energy,
)
