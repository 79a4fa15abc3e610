"""`act`, compiled where a run is long enough to make up for loading the compiler."""

from __future__ import annotations

from collections.abc import Callable

from .config import SimulatorConfig
from .disturbances import Disturbance
from .step import Plant, Trunk, act, at_rest

Act = Callable[[Trunk, float, Disturbance, Plant], Trunk]

# Runge-Kutta steps. Compiled code saves some microseconds in each; loading it takes
# some tenths of a second, and compiling it, once for each version, some seconds.
WORTH_COMPILING = 40_000


def worth_compiling(config: SimulatorConfig) -> bool:
    """Return True for a run that is long enough, or endless, to make up for loading the compiler."""
    steps = config.duration * config.update_rate * config.substeps
    return not 0.0 < steps < WORTH_COMPILING


def act_for(config: SimulatorConfig) -> Act:
    """Return `act` for a run with this configuration, ready to use: compiled if that is quicker, and can be.

    Both return the same bits.
    """
    if not worth_compiling(config):
        return act
    try:
        from trunk_msgs_util.compiled import ready
    except ImportError:  # numba is not needed, but quick
        return act
    plant = config.plant
    return ready(act, at_rest(config.initial_state, plant), 0.0, Disturbance(), plant)
