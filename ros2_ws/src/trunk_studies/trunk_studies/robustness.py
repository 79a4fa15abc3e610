"""The greatest value of a parameter that a controller withstands; the shares of random trunks that do."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, degrees, log, ulp
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from trunk_core.errors import PlanError, StudyError
from trunk_core.results import Keyword, Result
from trunk_core.units import seconds
from trunk_runs.offline_recording import Progress
from trunk_runs.plan import RunPlan
from trunk_runs.timeline import Push
from trunk_sim.plant import Plant

from .batch.block import Maker, summaries
from .batch.lanes import LANES
from .rows import AT_ONCE, make_bases, outcomes
from .statistics import wilson
from .study import StudySpec, Target, Variable, design

PlanAt = Callable[[float], RunPlan]
_FEW = 6  # start times in a line


class Limit(NamedTuple):
    """How far a parameter may go with a controller, in the parameter's SI unit."""

    controller: str
    stands: Annotated[float | None, "From the first value to here all tried stand; null: none"]
    falls: Annotated[float | None, "The first tried value beyond it, which falls; null: none does"]
    stands_again: Annotated[tuple[float, ...], "Tried values beyond that, which stand"]
    runs: Annotated[int, Keyword("minimum", 1)]
    recordings: Annotated[tuple[Path, ...], "Of the runs on either side, if there are any"] = ()


class PulseConditions(NamedTuple):
    """The disturbance's pulses; None is what varies."""

    channel: str | None
    start_times: list[float] | None
    duration: float | None
    magnitude: float | None


class PushCondition(NamedTuple):
    """A push whose value varies."""

    channel: str
    start: float
    duration: float


class Conditions(NamedTuple):
    """The other conditions of a limit. SI units and radians."""

    pulses: PulseConditions | None
    push: PushCondition | None
    fall_angle: float | None
    duration: float | None


def most_runs(first: float, last: float, within: float) -> int:
    """Return how many runs `find_limit` makes at most: each round divides a gap by ``LANES + 1``."""
    within = max(within, ulp(max(abs(first), abs(last))))
    gaps = max(1.0, abs(last - first) / (LANES - 1) / within)
    return LANES * (1 + ceil(log(gaps) / log(LANES + 1)))


def find_limit(
    plan_at: PlanAt, first: float, last: float, within: float,
    progress: Callable[[int], None] = lambda runs: None,
) -> Limit:  # fmt: skip
    """Return the last value on the way from ``first``, which stands, to ``last`` that stands, to ``within``.

    Neighbouring doubles are as near as it goes. ``last`` may be the smaller one. ``progress`` takes the
    number of runs that were made so far.
    Each round tries as many values as there are lanes: first the whole range, then between the last that
    stands and the first that falls. A fall need not be final: a stronger pulse may throw the trunk through to
    where it is caught, so what stands beyond is returned, too. Raises PlanError for a value that is refused.
    """
    tried: dict[float, bool] = {}
    values = np.linspace(first, last, LANES).tolist()
    while True:
        plans = [plan_at(value) for value in values]
        for value, run in zip(values, summaries(plans), strict=True):
            if run.refused:
                raise PlanError(f"{value:g}: {run.refused}")
            tried[value] = run.stood
        progress(len(tried))
        ordered = sorted(tried, reverse=last < first)
        count = next((k for k, value in enumerate(ordered) if not tried[value]), len(ordered))
        stands = ordered[count - 1] if count else None
        falls = ordered[count] if count < len(ordered) else None
        if falls is None or stands is None or abs(falls - stands) <= max(within, ulp(stands)):
            again = tuple(value for value in ordered[count:] if tried[value])
            return Limit(plans[0].controller_name, stands, falls, again, len(tried))
        values = np.linspace(stands, falls, LANES + 2)[1:-1].tolist()


def conditions_of(plan: RunPlan, varied: Collection[str], push: Push | None = None) -> Conditions:
    """Return the other conditions of a limit: the plan's pulses, the push that varies, when a run stands.

    None for what varies, ``NODE.PARAM`` in ``varied``.
    """
    pulses = None
    config = plan.disturbance
    if config is not None and config.signals.pulse_starts:
        pulses = PulseConditions(
            config.pulse_channel,
            [seconds(start) for start in config.signals.pulse_starts],
            config.pulse_duration,
            config.pulse_magnitude,
        )
        changing = {name.removeprefix("disturbance.pulse.").partition(".")[0] for name in varied}
        if any(name.startswith("disturbance.pulse.random_") for name in varied):
            changing.add("start_times")
        pulses = pulses._replace(**dict.fromkeys(changing & {*pulses._fields}))
    return Conditions(
        pulses,
        push and PushCondition(push.channel, push.start, push.duration),
        None if "simulator.fall.angle" in varied else plan.simulator.fall_angle,
        None if "simulator.duration" in varied else plan.simulator.duration,
    )


def condition_lines(conditions: Conditions, plant: Plant) -> list[str]:
    """Return in words what `conditions_of` returns of runs of a plant."""
    lines = []
    if conditions.pulses:
        channel, starts, lasting, value = conditions.pulses
        unit = plant.channel_units.get(channel or "", "")
        size = (
            ""
            if value is None
            else f"{degrees(value):.4g}°"
            if unit == "rad"
            else f"{value:.4g} {unit}"
        )
        of = f"{size} " if size else ""
        at = "varied" if starts is None else ", ".join(f"{start:g}" for start in starts[:_FEW])
        more = " …" if len(starts or ()) > _FEW else ""
        each = "varied" if lasting is None else f"{lasting:g} s"
        lines.append(
            f"pulses: {of}on {channel or 'a varied channel'}, for {each} each, from t = {at}{more} s"
        )
    if conditions.push:
        on, start, held = conditions.push
        lines.append(f"push: on {on}, for {held:g} s, from t = {start:g} s")
    angle, duration = conditions.fall_angle, conditions.duration
    limit = "simulator.fall.angle" if angle is None else f"{degrees(angle):.4g}°"
    run = "the run" if duration is None else f"the run, {duration:g} s"
    return [
        *lines,
        f"stands: the {plant.coordinates[1].joint} stays within {limit} throughout {run}",
    ]


class SurvivalPoint(NamedTuple):
    """The share of runs that stand a value."""

    value: float
    share: Annotated[float, "That stand, 0 to 1"]
    low: Annotated[float, "Wilson's interval, 95 %"]
    high: float


class Survival(NamedTuple):
    """How many of a study's runs stand each value of a parameter, for one controller."""

    controller: str
    runs: Annotated[int, Keyword("minimum", 1), "At each value"]
    half_falls_at: Annotated[float | None, "Between two tried values; null: not reached"]
    points: tuple[SurvivalPoint, ...]


@dataclass(frozen=True)
class LimitResult(Result, document="limit-1"):
    """The document of ``trunk limit``."""

    parameter: str
    unit: str
    pulses: Annotated[PulseConditions | None, "Of the disturbance; in it, null is what varies"]
    push: Annotated[PushCondition | None, "Whose value varies, with --push; else null"]
    fall_angle: Annotated[float | None, "A run stands within it; null: it varies"]
    duration: Annotated[float | None, "Of each run; null: it varies"]
    limits: Annotated[list[Limit], "One for each controller; empty with --study"]
    survival: Annotated[list[Survival], "With --study: one curve for each controller"]


def _half(points: Sequence[SurvivalPoint]) -> float | None:
    """Return the value at which half of the runs fall, between two tried ones; None: not reached."""
    for before, after in pairwise(points):
        if after.share < 0.5 <= before.share:
            part = (before.share - 0.5) / (before.share - after.share)
            return before.value + part * (after.value - before.value)
    return None


def survival(
    study: StudySpec,
    target: Target,
    values: Sequence[float],
    progress: Progress = lambda done, of: None,
    maker: Maker | None = None,
) -> Mapping[str, Survival]:
    """Return a survival curve for each controller of a study: every run of it, with each value.

    The study's draws are the same at every value. ``maker``: that of `outcomes`. Raises StudyError if the
    study varies the target itself, or if the parameter takes none of the values.
    """
    name = "limit"
    taken = [str(t) for v in study.variables for t in v.targets]
    if str(target) in taken:
        raise StudyError(f"{study.source}: it varies {target} itself: leave that out")
    varied = replace(
        study, variables=(*study.variables, Variable(name, (target,), "value", tuple(values)))
    )
    bases = make_bases(varied)
    counts: dict[str, dict[float, list[int]]] = {}
    at_once = study.block if maker is None else max(study.block, AT_ONCE)
    for first in range(0, varied.total, at_once):
        last = min(first + at_once, varied.total)
        columns = design(varied, first, last)
        ended = outcomes(varied, bases, columns, maker)
        if ended.refused:
            i = min(ended.refused)
            raise StudyError(f"{study.source}: run {columns['run'][i]}: {ended.refused[i]}")
        good = np.isnan(ended.diverged_at) & ~ended.fell
        for label, value, upright in zip(
            columns["controller"], columns[name], good.tolist(), strict=True
        ):
            count = counts.setdefault(label, {}).setdefault(value, [0, 0])
            count[0] += upright
            count[1] += 1
        progress(last, varied.total)
    curves = {}
    for controller, of_value in counts.items():
        points = tuple(SurvivalPoint(value, *wilson(*n)) for value, n in of_value.items())
        runs = max(of for _, of in of_value.values())
        curves[controller] = Survival(controller, runs, _half(points), points)
    return curves
