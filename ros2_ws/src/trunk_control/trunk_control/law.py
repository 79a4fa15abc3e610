"""What a control law consists of: pure functions, parameters, a name and a label."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from .computed_torque import Hip
from .controller_config import ControllerConfig
from .pid import Gains, PidLaw, PidState, Terms


class Sample(NamedTuple):
    """A law's inputs at one update."""

    reference: float  # rad
    measurement: float  # rad
    rate: float  # rad/s, measured
    dt: float  # s since the last update
    hip: Hip = Hip()  # as measured, for laws that use the hip


Constants = tuple[Any, ...]
Update = Callable[[PidState, Sample, Constants, PidLaw], tuple[PidState, Terms]]


def constant_gains(state: PidState, sample: Sample, constants: Constants) -> Gains:
    """Return the gains of a law whose first constant they are: they do not depend on the state."""
    gains: Gains = constants[0]
    return gains


@dataclass(frozen=True)
class Lookup:
    """For a law with tables: what it needs of them at a sample, while its inputs stay in one cell.

    Vector code cannot look up tables quickly, but a lane seldom leaves its cell. ``update`` gives the
    same bits with ``near(cell, constants)`` as with all constants.
    """

    inputs: Callable[[PidState, Sample, PidLaw], tuple[float, float]]
    cell: Callable[[float, float, Constants], Any]  # from the inputs
    near: Callable[[Any, Constants], Constants]
    # A cell is a named tuple of floats. The first four are the lower and the upper bound of either input,
    # the upper one excluded.
    kind: type[Any]


@dataclass(frozen=True)
class Law:
    """A control law. Its functions are pure: CPython runs them and numba compiles them unchanged.

    ``update(state, sample, constants, law)`` returns the next state and the terms of one update.
    ``gains(state, sample, constants)`` returns the gains at the last update and its sample, so that
    parameters can change without a jump. ``constants`` is the configuration's property of that name.
    """

    name: str  # also of the node, its executable and its section of parameters
    label: str  # in tables and plots
    config: type[ControllerConfig]
    update: Update
    gains: Callable[[PidState, Sample, Constants], Gains]
    describe: Callable[[Any], str] | None = None  # what the label lacks about a configuration
    lookup: Lookup | None = None
