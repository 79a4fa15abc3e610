"""Margins of sampled loops: how far each is from instability."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from math import inf
from typing import NamedTuple

import numpy as np

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_control.controller_config import ControllerConfig
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.lqr import LqrConfig
from trunk_control.pid import PidConfig
from trunk_control.pid_family import Gains

from ..plans.plan import RunPlan
from .linear import LinearLoop, loop_of


class Margins(NamedTuple):
    """How far a sampled loop is from instability."""

    gain_up: float  # factor on all gains at which it loses stability; infinite where it never does
    gain_down: float  # the same, downwards; 0 where it never does
    phase_deg: float
    modulus: float  # 1 / peak sensitivity: the smallest distance of L from -1
    delay: float  # s, the largest that it tolerates, in whole periods


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
    """The margins of the loop with some gains; None where it is unstable."""

    at: str  # which gains
    hip: str  # "prescribed" or "passive"
    loop: LinearLoop
    radius: float  # spectral radius of the sampled loop
    margins: Margins | None

    def as_values(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        return {
            "at": self.at,
            "hip": self.hip,
            "stable": self.margins is not None,
            "spectral_radius": self.radius,
            "margins": self.margins and self.margins._asdict(),
        }


def plan_margins(plan: RunPlan) -> list[LoopMargins]:
    """Return the margins of a plan's controllers about the upright, the hip prescribed and passive.

    Of a fuzzy gain box also those of its corners, as constant gains at the middle alpha: not a proof.
    Raises PlanError where a loop cannot be linearised.
    """
    rows = []
    for name, config in plan.controllers.items():
        candidates: dict[str, ControllerConfig] = {name: config}
        if isinstance(config, FuzzyPidConfig):
            candidates |= {at: _constant(config, gains) for at, gains in _corners(config).items()}
        for at, candidate in candidates.items():
            for hip in ("prescribed", "passive"):
                loop = loop_of(plan.simulator, candidate, hip == "prescribed")
                within = margins(loop) if loop.stable else None
                rows.append(LoopMargins(at, hip, loop, loop.radius(), within))
    return rows


THIN_PHASE_DEG, THIN_MODULUS, THIN_GAIN = 30.0, 0.5, 2.0  # less is thin: Astrom and Murray, 10.3


def weakness(row: LoopMargins) -> str:
    """Return in words why a loop is not sound: unstable, or with thin margins; empty if it is."""
    m = row.margins
    if m is None:
        return f"UNSTABLE, spectral radius {row.radius:.6g}"
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
    body = plan.simulator.body
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
