"""What ``trunk tune`` prints of its result, the margins of the sampled loop, and the file that it writes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from trunk_control.pid import Gains
from trunk_msgs_util.parameters.declarations import Value, build, values_of
from trunk_msgs_util.parameters.files import write
from trunk_msgs_util.units import seconds

from ...console.document import write_json
from ...console.tables import print_table
from ...console.terminal import show_warnings
from ...plans.nodes import NODES
from ...plans.plan import RunPlan

if TYPE_CHECKING:
    from ...tuning.linear import Linear, Margins
    from ...tuning.methods import Ultimate


def finish(
    plan: RunPlan,
    gains: Gains,
    options: dict[str, Any],
    others: dict[str, Value] | None = None,
    plant: Linear | None = None,
    how: dict[str, object] | None = None,
) -> None:
    """Do as `finish_values` with the gains of a PID, and ``others``."""
    values: dict[str, Value] = {f"gains.{n}": getattr(gains, n) for n in "pid"}
    finish_values(plan, {**values, **(others or {})}, options, plant, how)


def finish_values(
    plan: RunPlan,
    values: dict[str, Value],
    options: dict[str, Any],
    plant: Linear | None = None,
    how: dict[str, object] | None = None,
) -> None:
    """Print the gains and their margins and write the file; refuse what the node would refuse.

    ``how``: the method's own results in the JSON document, under the method's name.
    """
    name = plan.controller_name
    config = build(NODES[name].config, {**values_of(plan.controller), **values})
    loops = margins_of(plan, config, plant)
    if options["output"] is not None:
        write(options["output"], {name: values})
    if options["as_json"]:
        document = {
            "controller": name,
            "output": options["output"],
            "parameters": values,
            "update_rate_hz": plan.controller.update_rate,
            "margins": [loop.as_values() for loop in loops],
            "relay": None,
            "search": None,
        }
        write_json("tune-1", {**document, **(how or {})})
        return
    print_table(
        name,
        ("parameter", "value"),
        [
            (key, f"{value:.6g}" if isinstance(value, float) else str(value))
            for key, value in values.items()
        ],
    )
    print_margins(plan, loops)
    if options["output"] is not None:
        click.echo(f"{options['output']}: for --params, or ros2 run … --ros-args --params-file")


def show_relay(ultimate: Ultimate) -> None:
    """Print a relay experiment as a table."""
    print_table(
        "relay experiment",
        ("quantity", "relay", "Routh", "unit"),
        [
            ("Ku", f"{ultimate.gain:.5g}", f"{ultimate.exact_gain:.5g}", "N m/rad"),
            ("Tu", f"{ultimate.period:.5g}", f"{ultimate.exact_period:.5g}", "s"),
            ("amplitude", f"{ultimate.amplitude:.5g}", "", "rad"),
        ],
    )


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
    from ...tuning.linear import LinearLoop, linearise, margins

    linear = plant or linearise(plan.simulator.body)
    if plan.controller_name == "computed_torque":
        linear = linear._replace(a=0.0, b=1.0)
    corners = {"gains": config.gains} if hasattr(config, "gains") else _corners(config)
    loops = []
    for label, gains in corners.items():
        loop = LinearLoop(
            linear, gains, seconds(plan.controller.period_ns), config.derivative_mode == "rate"
        )
        loops.append(LoopMargins(label, margins(loop) if loop.stable else None, loop.radius()))
    return loops


def print_margins(plan: RunPlan, loops: Sequence[LoopMargins]) -> None:
    """Print margins as a table."""
    if not loops:
        click.echo(f"no margins: {plan.controller_name} has no gains to linearise with")
        return
    if plan.simulator.actuator is not None:
        without = "the margins are for a drive without lag, limits and friction"
        show_warnings([f"{without}; trunk study map draws the multipliers with its lag"])
    if plan.simulator.network is not None:
        show_warnings(["the margins are for a loop without links"])
    rows = []
    for at, m, radius in loops:
        if m is None:
            rows.append((at, "UNSTABLE", f"spectral radius {radius:.4g}", "", "", ""))
            continue
        gain = f"{m.gain_down:.3g} to {m.gain_up:.3g}"
        phase, modulus = f"{m.phase_deg:.1f}", f"{m.modulus:.3f}"
        rows.append((at, gain, phase, modulus, f"{1e3 * m.delay:.4g}", f"{radius:.6f}"))
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
