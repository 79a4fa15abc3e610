"""What PID-like laws share: memory, terms, and bumpless takeover and retuning through the integral."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .controller_config import ControllerConfig
from .law import Constants, Law, Lookup, Retune, Sample, TakeOver, Update
from .pid import Gains, PidLaw, PidState, Terms, retune

GainsOf = Callable[[PidState, Sample, Constants], Gains]
UNITS = {
    "error": "rad",
    "error_rate": "rad/s",
    "p_term": "N m",
    "i_term": "N m",
    "d_term": "N m",
    "kp": "N m/rad",
    "ki": "N m/(rad s)",
    "kd": "N m s/rad",
    "alpha": "",  # a ratio
    "unsaturated": "N m",
    "effort": "N m",
}


def law_of_pid_kind(
    name: str,
    label: str,
    config: type[ControllerConfig],
    update: Update,
    gains: GainsOf,
    describe: Callable[[Any], str] | None = None,
    lookup: Lookup | None = None,
) -> Law:
    """Return a law whose memory is `PidState` and whose terms are `Terms`.

    ``gains(memory, sample, constants)`` returns the gains at the last update and its sample.
    """
    return Law(
        name,
        label,
        config,
        update,
        PidState(),
        Terms,
        UNITS,
        take_over_by_integral(update),
        retune_by_integral(gains),
        describe,
        lookup,
    )


def constant_gains(memory: PidState, sample: Sample, constants: Constants) -> Gains:
    """Return the gains of a law that has them as its first constant, whatever its memory."""
    gains: Gains = constants[0]
    return gains


def take_over_by_integral(update: Update) -> TakeOver:
    """Return the function that makes a law's command continue from the torque that acts.

    ``I = (u - u|I=0) / ki``. The derivative starts from the last state seen, so that it contains no
    jump of the reference. What the integral cannot absorb (ki = 0, its limits), the command makes up
    in bounded steps.
    """

    def take_over(
        initial: PidState,
        seen: float,
        sample: Sample,
        effort: float,
        constants: Constants,
        limits: PidLaw,
    ) -> PidState:
        memory = PidState(0.0, sample.reference - seen, seen, 0.0, effort, True)
        _, terms = update(memory, sample, constants, limits)
        if terms.ki > 0.0:
            integral = (effort - terms.unsaturated) / terms.ki
            if integral - integral == 0.0:
                memory = PidState(integral, memory.error, seen, 0.0, effort, True)
        return memory

    return take_over


def retune_by_integral(gains: GainsOf) -> Retune:
    """Return the function that rescales the integral as `pid.retune` does."""

    def retuned(memory: PidState, sample: Sample, before: Constants, after: Constants) -> PidState:
        return retune(memory, gains(memory, sample, before), gains(memory, sample, after))

    return retuned
