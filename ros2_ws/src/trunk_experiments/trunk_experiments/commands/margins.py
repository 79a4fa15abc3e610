"""The margins of a sampled loop, as ``trunk tune`` prints them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from trunk_control.pid import Gains
from trunk_msgs_util.units import seconds

from ..console.tables import print_table
from ..plans.plan import RunPlan

if TYPE_CHECKING:
    from ..tuning.linear import Linear, Margins


class LoopMargins(NamedTuple):
    """The margins of the loop with some gains; None where it is unstable."""

    at: str  # which gains
    margins: Margins | None
    radius: float  # spectral radius of the sampled loop

    def as_values(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        return {
            "at": self.at,
            "stable": self.margins is not None,
            "spectral_radius": self.radius,
            "margins": self.margins and self.margins._asdict(),
        }


def margins_of(plan: RunPlan, config: Any, plant: Linear | None = None) -> list[LoopMargins]:
    """Return the margins of a controller's configuration around a plan's plant, or another linear one.

    For a fuzzy gain box, corner by corner; a law without gains has no margins of this kind.
    """
    if not (hasattr(config, "gains") or hasattr(config, "alpha_centers")):
        return []
    from ..tuning.linear import LinearLoop, linearise, margins

    linear = plant or linearise(plan.simulator.body)
    if plan.controller_name == "computed_torque":
        linear = linear._replace(a=0.0, b=1.0)
    corners = {"gains": config.gains} if hasattr(config, "gains") else _corners(config)
    found = []
    for label, gains in corners.items():
        loop = LinearLoop(
            linear, gains, seconds(plan.controller.period_ns), config.derivative_mode == "rate"
        )
        found.append(LoopMargins(label, margins(loop) if loop.stable else None, loop.radius()))
    return found


def print_margins(plan: RunPlan, found: Sequence[LoopMargins]) -> None:
    """Print margins as a table."""
    if not found:
        click.echo(f"no margins: {plan.controller_name} has no gains to linearise with")
        return
    if plan.simulator.actuator is not None:
        told = "trunk: warning: the margins are for a drive without lag, limits and friction"
        click.echo(f"{told}; trunk study map draws the multipliers with its lag", err=True)
    if plan.simulator.network is not None:
        click.echo("trunk: warning: the margins are for a loop without links", err=True)
    rows = []
    for one in found:
        m = one.margins
        if m is None:
            rows.append((one.at, "UNSTABLE", f"spectral radius {one.radius:.4g}", "", "", ""))
            continue
        rows.append(
            (
                one.at,
                f"{m.gain_down:.3g} to {m.gain_up:.3g}",
                f"{m.phase_deg:.1f}",
                f"{m.modulus:.3f}",
                f"{1e3 * m.delay:.4g}",
                f"{one.radius:.6f}",
            )
        )
    print_table(
        f"margins of the sampled loop at {plan.controller.update_rate:g} Hz, linearised trunk",
        ("at", "gain, factor", "phase °", "modulus", "delay ms", "spectral radius"),
        rows,
    )


def _corners(config: Any) -> dict[str, Gains]:
    """Return the corners of a fuzzy gain box, at the middle alpha: constant gains, not a proof."""
    alpha = sum(config.alpha_centers) / len(config.alpha_centers)
    return {
        f"kp {p:.4g}, kd {d:.4g}": Gains(p, p * p / (alpha * d), d)
        for p in (config.p_min, config.p_max)
        for d in (config.d_min, config.d_max)
    }
