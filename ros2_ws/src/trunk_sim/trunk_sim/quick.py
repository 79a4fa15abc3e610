"""`act`, compiled where a run is long enough to make up for loading the compiler."""

from __future__ import annotations

from collections.abc import Callable

from trunk_msgs_util.compilable import with_arrays

from .actuator import Actuator
from .config import SimulatorConfig
from .disturbances import Disturbance
from .step import Plant, Trunk, act, at_rest

Act = Callable[[Trunk, float, Disturbance, Plant], Trunk]

# Runge-Kutta steps. Loading compiled code takes 0.7 s, and compiling it, once for each version, some seconds.
WORTH_COMPILING = 40_000  # a loop, which saves some ten microseconds in each
WORTH_A_STEP = 150_000  # a single step, which saves four
ENDLESS_S = 600.0  # how long an endless run counts as


def worth_compiling(config: SimulatorConfig, first: int = 0) -> bool:
    """Return True for a run that is long enough to make up for loading a loop's compiled code.

    ``first``: the index of the state that it goes on from.
    """
    return _steps(config) - first * config.substeps >= WORTH_COMPILING


def act_for(config: SimulatorConfig, loaded: bool = False) -> Act:
    """Return `act` for a run with this configuration, ready to use: compiled if that is quicker and possible.

    Both return the same bits. ``loaded``: the compiler is already loaded for something else.
    """
    if _steps(config) < (WORTH_COMPILING if loaded else WORTH_A_STEP):
        return act
    try:
        from trunk_msgs_util.compiled import ready
    except ImportError:  # numba is optional
        return act
    start = at_rest(config.initial_state, config.plant)
    return ready(act, start, 0.0, Disturbance(), _with_array(config.plant))


def _steps(config: SimulatorConfig) -> float:
    return (config.duration or ENDLESS_S) * config.update_rate * config.substeps


def plant_for(function: Act, plant: Plant) -> Plant:
    """Return the plant as this function takes it: unchanged for `act`, with arrays if compiled."""
    return plant if function is act else _with_array(plant)


def _with_array(plant: Plant) -> Plant:
    """Return a plant whose harmonics are an array, empty if there are none, and that has an actuator.

    Its type never changes, so nothing is recompiled when a running simulator's path or actuator changes.
    """
    body = plant.body._replace(harmonics=plant.body.harmonics or ())
    return with_arrays(plant._replace(body=body, actuator=plant.actuator or Actuator()))
