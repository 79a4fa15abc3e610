"""Margins of sampled loops: how far each is from instability, in numbers and in a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.law import ControllerConfig
from trunk_control.lqr import LqrConfig
from trunk_control.pid import PidConfig
from trunk_control.pid_family import Gains
from trunk_core.results import OMITTED, Result
from trunk_runs.plan import RunPlan
from trunk_sim.plant import TRUNK, Accelerations

from .linear import LinearLoop, loop_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Hip = Literal["prescribed", "passive"]


class Margins(NamedTuple):
    """How far a sampled loop is from instability."""

    gain_up: Annotated[float, "Factor on all gains at which it loses stability; infinite: never"]
    gain_down: Annotated[float, "The same, downwards; 0: never"]
    phase_deg: float
    modulus: Annotated[float, "1 / peak sensitivity: the smallest distance of L from -1"]
    delay: Annotated[float, "s, the largest that it tolerates, in whole periods"]


def margins(loop: LinearLoop) -> Margins:
    """Return a stable loop's margins. Raises ValueError if it is not stable.

    Gain margins are found by bisection on the loop's eigenvalues, the phase margin at the crossovers of
    the frequency response, the modulus margin on a grid of 8000 frequencies.
    """
    if not loop.stable:
        raise ValueError("the loop is unstable: it has no margins")
    crossing = loop.response(loop.crossovers())
    phase = np.abs(np.degrees(np.angle(-crossing)))
    return Margins(
        _edge(loop, 1.0, 1e4),
        _edge(loop, 1.0, 1e-4),
        float(np.min(phase)) if len(phase) else inf,
        float(np.min(np.abs(1.0 + loop.response(loop.frequencies())))),
        largest_delay(loop) * loop.h,
    )


def largest_delay(loop: LinearLoop, limit: int = 400) -> int:
    """Return how many periods of delay the loop tolerates on top of its own, up to a limit.

    A delay changes only the phase: an eigenvalue leaves the unit circle first at the crossover whose phase
    margin is used up first. The loop's eigenvalues decide on which side of that delay a whole period lies.
    """

    def stable(extra: int) -> bool:
        return replace(loop, delay=loop.delay + extra).stable

    w = loop.crossovers()
    left = np.mod(np.angle(loop.response(w)) + np.pi, 2.0 * np.pi) / (w * loop.h)
    delay = int(min(np.min(left, initial=inf), limit))
    while delay > 0 and not stable(delay):
        delay -= 1
    while delay < limit and stable(delay + 1):
        delay += 1
    return delay


def _edge(loop: LinearLoop, inside: float, outside: float) -> float:
    """Return the factor on all gains at which stability ends, between 1 and ``outside``."""

    def stable(factor: float) -> bool:
        return replace(loop, factor=factor * loop.factor).stable

    steps = np.geomspace(inside, outside, 200)
    unstable = next((float(f) for f in steps[1:] if not stable(float(f))), None)
    if unstable is None:
        return inf if outside > 1.0 else 0.0
    good = float(steps[list(steps).index(unstable) - 1])
    for _ in range(50):
        middle = (good * unstable) ** 0.5
        good, unstable = (middle, unstable) if stable(middle) else (good, middle)
    return good


class LoopMargins(NamedTuple):
    """The margins of the loop with some gains."""

    at: Annotated[str, "The controller, or a corner of its gain box"]
    hip: Hip
    stable: bool
    spectral_radius: Annotated[float, "Of the sampled loop"]
    margins: Annotated[Margins | None, "null: unstable"]
    loop: Annotated[LinearLoop, OMITTED]


@dataclass(frozen=True)
class MarginsResult(Result, document="margins-1"):
    """The document of ``trunk margins``."""

    file: Annotated[Path | None, "The recording; null: of parameters"]
    output: Annotated[Path | None, "The picture; null: none asked for"]
    update_rate_hz: float
    margins: Annotated[list[LoopMargins], "About the upright; also at corners of a gain box"]


def plan_margins(plan: RunPlan) -> list[LoopMargins]:
    """Return the margins of a plan's controllers at rest, the hip prescribed, where that can be, and passive.

    Of a fuzzy gain box also those of its corners, as constant gains at the middle alpha: not a proof.
    Raises PlanError where a loop cannot be linearised.
    """
    kind = plan.simulator.kind
    equations: dict[Hip, Accelerations] = {"passive": kind.accelerations}
    if kind.held is not None:
        equations = {"prescribed": kind.held, **equations}
    rows = []
    for name, config in plan.controllers.items():
        candidates: dict[str, ControllerConfig] = {name: config}
        if isinstance(config, FuzzyPidConfig):
            candidates |= {at: _constant(config, gains) for at, gains in _corners(config).items()}
        for at, candidate in candidates.items():
            for hip, accelerations in equations.items():
                loop = loop_of(plan.simulator, candidate, accelerations)
                within = margins(loop) if loop.stable else None
                stable = within is not None
                rows.append(LoopMargins(at, hip, stable, loop.radius(), within, loop))
    return rows


THIN_PHASE_DEG, THIN_MODULUS, THIN_GAIN = 30.0, 0.5, 2.0  # less is thin: Astrom and Murray, 10.3


def weakness(row: LoopMargins) -> str:
    """Return in words why a loop is not sound: unstable, or with thin margins; empty if it is."""
    m = row.margins
    if m is None:
        return f"UNSTABLE, spectral radius {row.spectral_radius:.6g}"
    low = []
    if m.phase_deg < THIN_PHASE_DEG:
        low.append(f"phase margin {m.phase_deg:.1f}° (30° is usual)")
    if m.modulus < THIN_MODULUS:
        low.append(f"modulus margin {m.modulus:.3f} (0.5 is usual)")
    if m.gain_up < THIN_GAIN:
        low.append(f"unstable with {m.gain_up:.3g} times the gains (2 is usual)")
    if m.gain_down * THIN_GAIN > 1.0:
        low.append(f"unstable with {m.gain_down:.3g} times the gains (0.5 is usual)")
    return f"thin margins: {', '.join(low)}" if low else ""


def other_plants(plan: RunPlan) -> Iterator[str]:
    """Yield a warning for each controller whose model is of another plant than the plan's."""
    body, kind = plan.simulator.constants, plan.simulator.kind
    if kind.name != TRUNK:
        for name, config in plan.controllers.items():
            if isinstance(config, LqrConfig) and config.gravity_torque != 0.0:
                yield f"{name}: model.gravity_torque is the trunk's, not of the {kind.name}: set it to 0"
        return
    weight = body.trunk_mass * body.gravity * body.length
    for name, config in plan.controllers.items():
        if isinstance(config, LqrConfig) and not _near(config.gravity_torque, weight):
            yield (
                f"{name}: model.gravity_torque is {config.gravity_torque:.6g} N m, m g l of this plant "
                f"{weight:.6g}: made for another plant; trunk tune lqr makes gains for this one"
            )
        if isinstance(config, ComputedTorqueConfig):
            for part in ("trunk_mass", "length", "gravity"):
                believed, real = getattr(config, part), getattr(body, part)
                if not _near(believed, real):
                    yield f"{name}: model.{part} is {believed:g}, plant.{part} {real:g}"


def _near(believed: float, real: float) -> bool:
    return abs(believed - real) <= 0.01 * abs(real)


def _corners(config: FuzzyPidConfig) -> dict[str, Gains]:
    alpha = sum(config.alpha_centers) / len(config.alpha_centers)
    return {
        f"kp {p:.4g}, kd {d:.4g}": Gains(p, p * p / (alpha * d), d)
        for p in (config.p_min, config.p_max)
        for d in (config.d_min, config.d_max)
    }


def _constant(config: FuzzyPidConfig, gains: Gains) -> PidConfig:
    """Return a PID with these gains and the rest of a configuration."""
    shared = {f.name: getattr(config, f.name) for f in fields(ControllerConfig)}
    return PidConfig(**shared, p=gains.p, i=gains.i, d=gains.d)


_FACTORS = np.geomspace(0.05, 20.0, 300)  # of all gains, in the root locus
_STEP_S = 3.0  # shown of the step
_DASHES: dict[str, Any] = {"prescribed": "solid", "passive": (0, (5, 2))}


def draw(rows: Sequence[LoopMargins], title: str, words: Callable[[str], str] = str) -> Figure:
    """Return a figure of the loops, as control engineers draw them: Bode, Nyquist, root locus, step.

    A colour for each controller, dashed with a passive hip.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from trunk_views.plots import COLORS, STYLE

    colors = {at: COLORS[k % len(COLORS)] for k, at in enumerate(dict.fromkeys(r.at for r in rows))}
    with rc_context(STYLE):
        figure = Figure(figsize=(12.0, 8.0), layout="constrained")
        axes = figure.subplot_mosaic(
            [["magnitude", "nyquist"], ["phase", "nyquist"], ["step", "locus"], ["step", "locus"]]
        )
        axes["magnitude"].sharex(axes["phase"])
        for row in rows:
            style: dict[str, Any] = {"color": colors[row.at], "linestyle": _DASHES[row.hip]}
            _bode(axes["magnitude"], axes["phase"], row.loop, style)
            response = row.loop.response(row.loop.frequencies())
            axes["nyquist"].plot(response.real, response.imag, **style)
            _root_locus(axes["locus"], row.loop, colors[row.at])
            label = f"{row.at}, {words('hip')} {row.hip}" + ("" if row.margins else ": UNSTABLE")
            angles = row.loop.step_response(int(_STEP_S / row.loop.h))
            times = np.arange(len(angles)) * row.loop.h
            axes["step"].plot(times, np.clip(angles, -3.0, 3.0), label=label, **style)
        _dress(axes, words)
        handles, labels = axes["step"].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4))
        figure.suptitle(title)
    return figure


def _bode(magnitude: Axes, phase: Axes, loop: LinearLoop, style: dict[str, Any]) -> None:
    frequency = loop.frequencies()
    response = loop.response(frequency)
    degrees = np.degrees(np.unwrap(np.angle(response)))
    # Whole turns are arbitrary: at high frequencies a lag is shown below 0.
    crossing = int(np.argmin(np.abs(np.log(np.abs(response)))))
    magnitude.loglog(frequency, np.abs(response), **style)
    phase.semilogx(frequency, degrees - 360.0 * np.ceil(degrees[crossing] / 360.0), **style)


def _root_locus(plot: Axes, loop: LinearLoop, color: str) -> None:
    roots = [np.linalg.eigvals(replace(loop, factor=float(f)).matrix()) for f in _FACTORS]
    for points, marker, size in (
        (np.concatenate(roots), ".", 1.5),
        (np.linalg.eigvals(loop.matrix()), "x", 8.0),
    ):
        s = np.log(points[np.abs(points) > 1e-6].astype(complex)) / loop.h
        plot.plot(s.real, s.imag, marker, color=color, markersize=size)


def _dress(axes: dict[str, Axes], words: Callable[[str], str]) -> None:
    axes["magnitude"].axhline(1.0, color="black", linewidth=0.8)
    axes["magnitude"].set(
        ylabel="|L|", ylim=(1e-2, 1e2), title=words("Bode: open loop, cut at the torque")
    )
    axes["magnitude"].tick_params(labelbottom=False)
    axes["phase"].axhline(-180.0, color="black", linewidth=0.8)
    axes["phase"].set(xlabel="frequency, rad/s", ylabel="phase of L, °", xlim=(0.1, None))
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    axes["nyquist"].plot(np.cos(angle), np.sin(angle), color="gray", linewidth=0.8)
    axes["nyquist"].plot([-1.0], [0.0], "+", color="black", markersize=12)
    axes["nyquist"].set_aspect("equal", adjustable="box")
    axes["nyquist"].set(
        xlim=(-8.0, 2.0), ylim=(-4.0, 4.0), xlabel="Re L", ylabel="Im L",
        title="Nyquist: the loop is stable if L goes once around −1",
    )  # fmt: skip
    axes["locus"].axvline(0.0, color="black", linewidth=0.8)
    axes["locus"].set(
        xlim=(-60.0, 15.0), ylim=(-30.0, 30.0), xlabel="Re s, 1/s", ylabel="Im s, rad/s",
        title="Root locus, s = ln z / h: 0.05 to 20 times the gains; × as they are",
    )  # fmt: skip
    axes["step"].set(
        xlabel="time, s",
        ylabel="angle / reference",
        ylim=(-0.5, 2.0),
        title="Step of the reference",
    )
