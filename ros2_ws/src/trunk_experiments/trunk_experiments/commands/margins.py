"""The margins of a sampled loop, as ``trunk tune`` prints them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from trunk_control.pid import Gains
from trunk_msgs_util.units import seconds

from ..console.tables import print_table
from ..plans.plan import RunPlan

if TYPE_CHECKING:
    from ..tuning.linear import Linear


def print_margins(plan: RunPlan, config: Any, plant: Linear | None = None) -> None:
    """Print the margins of a controller's configuration around a plan's plant, or another linear one.

    A fuzzy gain box is shown corner by corner; a law without gains has no margins of this kind.
    """
    if not (hasattr(config, "gains") or hasattr(config, "alpha_centers")):
        click.echo(f"no margins: {plan.controller_name} tells no gains to linearise with")
        return
    from ..tuning.linear import LinearLoop, linearise, margins

    linear = plant or linearise(plan.simulator.body)
    if plan.controller_name == "computed_torque":
        linear = linear._replace(a=0.0, b=1.0)
    corners = {"gains": config.gains} if hasattr(config, "gains") else _corners(config)
    rows = []
    for label, gains in corners.items():
        loop = LinearLoop(
            linear, gains, seconds(plan.controller.period_ns), config.derivative_mode == "rate"
        )
        if not loop.stable:
            rows.append((label, "UNSTABLE", f"spectral radius {loop.radius():.4g}", "", "", ""))
            continue
        m = margins(loop)
        rows.append(
            (
                label,
                f"{m.gain_down:.3g} to {m.gain_up:.3g}",
                f"{m.phase_deg:.1f}",
                f"{m.modulus:.3f}",
                f"{1e3 * m.delay:.4g}",
                f"{loop.radius():.6f}",
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
