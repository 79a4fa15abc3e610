"""``trunk explain``: why this torque at this instant."""

from __future__ import annotations

from math import degrees, isfinite
from pathlib import Path
from typing import Any

import click

from trunk_control.law import OUTCOME
from trunk_sim.disturbances import Disturbance

from ..console.document import json_option, write_json
from ..console.options import Number
from ..console.reading import open_run, run_values, show_damage
from ..console.tables import print_table
from ..console.terminal import show_warnings
from ..replay.doubts import refused
from ..replay.explain import Explanation, explain
from ..replay.external import ExternalCommand, external_command


@click.command("explain")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--at",
    type=Number("s"),
    required=True,
    metavar="S",
    help="The instant, s; for another robot, counted from its first state.",
)
@json_option("explain-1", "explain-external-1")
@click.pass_context
def command(ctx: click.Context, run: Path, at: float, as_json: bool) -> None:
    """Explain why the controller of a recorded run commanded this torque at this instant.

    Exit code 0: the recomputed command equals the recorded one, or differs only by rounding, because it was
    recorded in another arithmetic; 1: it differs.
    """
    recorded = open_run(run)
    show_damage(recorded)
    show_warnings(refused(recorded))
    if recorded.external:
        known = external_command(recorded, at)
        if as_json:
            write_json("explain-external-1", {**run_values(recorded), **_external_values(known)})
        else:
            _show_external(known)
        return
    found = explain(recorded, at)
    if as_json:
        write_json("explain-1", {**run_values(recorded), **as_values(found)})
    else:
        _show(found)
    ctx.exit(0 if found.agrees or found.rounded_otherwise else 1)


def _external_values(known: ExternalCommand) -> dict[str, Any]:
    """Return what is known of somebody else's command as plain values."""
    return {
        "asked_s": known.asked,
        "controller": known.controller,
        "command": known.command,
        "answers_s": known.answers,
        "reference": _finite(known.reference),
        "measurement": _finite(known.measurement),
        "true_angle": _finite(known.true_angle),
        "disturbance": known.disturbance._asdict(),
        "applied": _finite(known.applied),
        "terms": {name: _finite(value) for name, value in known.terms.items()},
    }


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _show_external(known: ExternalCommand) -> None:
    """Print what is known of somebody else's command."""
    terms = "" if known.terms else "; its terms were not recorded"
    if known.command is None:
        click.echo(f"t = {known.asked:g} s: no command of {known.controller} is in force{terms}")
    else:
        answers = "acts since it arrived" if known.arrived else f"answers t = {known.answers:g} s"
        click.echo(
            f"t = {known.asked:g} s: torque from {known.controller}: {known.command:.6g} N m, "
            f"{answers}{terms}"
        )
    rows = [
        ("reference", f"{degrees(known.reference):.6g}", "deg"),
        ("measured angle", f"{degrees(known.measurement):.6g}", "deg"),
        ("true angle", f"{degrees(known.true_angle):.6g}", "deg"),
        ("error e", f"{degrees(known.reference - known.true_angle):.6g}", "deg"),
        *_disturbance_rows(known.disturbance),
        ("torque applied to the plant", f"{known.applied:.6g}", "N m"),
    ]
    print_table("what is known", ("quantity", "value", "unit"), rows)
    if known.terms:
        named = [(name, f"{value:.6g}", "") for name, value in known.terms.items()]
        print_table(f"terms of {known.controller}, as it names them", ("term", "value", ""), named)


def _disturbance_rows(acting: Disturbance) -> list[tuple[str, str, str]]:
    units = ("N", "N m", "m", "deg")
    rows = [
        (
            f"disturbance: {name.replace('_', ' ')}",
            f"{degrees(value) if unit == 'deg' else value:.6g}",
            unit,
        )
        for (name, value), unit in zip(acting._asdict().items(), units, strict=True)
        if value
    ]
    return rows or [("disturbance", "none", "")]


def as_values(found: Explanation) -> dict[str, Any]:
    """Return an explanation as plain values; None for an infinite limit."""
    return {
        "asked_s": found.asked,
        "update_s": found.update,
        "controller": found.controller,
        "reference": found.reference,
        "measurement": found.measurement,
        "rate": found.rate,
        "true_angle": found.true_angle,
        "derivative_mode": found.derivative_mode,
        "disturbance": found.disturbance._asdict(),
        "rules": [rule._asdict() for rule in found.rules],
        "terms": found.terms._asdict(),
        "units": dict(found.units),
        "by_model": found.by_model,
        "limits": [bound if isfinite(bound) else None for bound in found.limits],
        "limited": found.limited,
        "handing_over": found.handing_over,
        "anti_windup": (
            None
            if found.windup is None
            else {**found.windup._asdict(), "acted": found.windup.acted}
        ),
        "took_over": found.took_over,
        "recorded": found.recorded,
        "agrees": found.agrees,
        "arithmetic": found.arithmetic or None,
        "rounded_otherwise": found.rounded_otherwise,
        "applied": found.applied,
    }


def _shares(found: Explanation) -> list[tuple[str, str, str]]:
    """Return the rows of the terms that a law of the PID's kind adds up."""
    terms = found.terms
    return [
        ("P: Kp e", f"{terms.p_term:.6g}", "N m"),
        ("I: Ki times the integral", f"{terms.i_term:.6g}", "N m"),
        ("D: Kd times the derivative", f"{terms.d_term:.6g}", "N m"),
        *([("from the model", f"{found.by_model:.6g}", "N m")] if found.by_model else []),
        ("their sum", f"{terms.unsaturated:.6g}", "N m"),
    ]


def _gains(found: Explanation) -> list[tuple[str, str, str]]:
    """Return the rows of its gains."""
    terms = found.terms
    return [
        ("Kp", f"{terms.kp:.6g}", "N m/rad"),
        ("Ki", f"{terms.ki:.6g}", "N m/(rad s)"),
        ("Kd", f"{terms.kd:.6g}", "N m s/rad"),
        ("alpha = Kp^2 / (Ki Kd)", f"{terms.alpha:.6g}", ""),
    ]


def _own_terms(found: Explanation) -> list[tuple[str, str, str]]:
    """Return the rows of another law's terms, as it names them."""
    named = [name for name in found.terms._fields if name not in OUTCOME]
    rows = [
        (name.replace("_", " "), f"{getattr(found.terms, name):.6g}", found.units.get(name, ""))
        for name in named
    ]
    return [*rows, ("command before the limits", f"{found.terms.unsaturated:.6g}", "N m")]


def _show(found: Explanation) -> None:
    terms, windup = found.terms, found.windup
    click.echo(
        f"t = {found.asked:g} s: {found.controller} holds {terms.effort:.6g} N m, "
        f"computed at t = {found.update:g} s"
    )
    rows = [
        ("reference", f"{degrees(found.reference):.6g}", "deg"),
        ("measured angle", f"{degrees(found.measurement):.6g}", "deg"),
        (
            ("true angle", "not known: another robot", "")
            if found.true_angle is None
            else ("true angle", f"{degrees(found.true_angle):.6g}", "deg")
        ),
        ("error e", f"{degrees(found.error):.6g}", "deg"),
        (
            ("measured rate", f"{found.rate:.6g}", "rad/s")
            if windup is None
            else (
                f"its derivative (mode {found.derivative_mode})",
                f"{terms.error_rate:.6g}",
                "rad/s",
            )
        ),
    ]
    rows += _disturbance_rows(found.disturbance)
    print_table("inputs", ("quantity", "value", "unit"), rows)
    if found.rules:
        print_table(
            "rules that fired",
            ("if e is", "and e_dot is", "weight", "Kp'", "Kd'", "alpha"),
            [
                (
                    rule.error_label,
                    rule.rate_label,
                    f"{rule.weight:.6f}",
                    f"{rule.kp_label} = {rule.kp:.6g}",
                    f"{rule.kd_label} = {rule.kd:.6g}",
                    f"{rule.alpha_label} = {rule.alpha:.6g}",
                )
                for rule in found.rules
                if rule.weight > 0.0
            ],
        )
    low, high = found.limits
    free = not (isfinite(low) or isfinite(high))
    print_table(
        "outputs",
        ("quantity", "value", "unit"),
        [
            *(_own_terms(found) if windup is None else _shares(found)),
            (
                "limits of the handover" if found.handing_over else "limits",
                "none" if free else f"{low:g} … {high:g}",
                "" if free else "N m",
            ),
            ("command" + (", limited" if found.limited else ""), f"{terms.effort:.6g}", "N m"),
            (
                ("torque applied to the robot", "not known", "")
                if found.applied is None
                else ("torque applied to the plant", f"{found.applied:.6g}", "N m")
            ),
            *([] if windup is None else _gains(found)),
        ],
    )
    if found.took_over:
        click.echo(
            f"{found.controller} took over here: it continued from the torque that acted, without a jump"
        )
    if windup is not None:
        acted = "acted" if windup.acted else "did not act"
        click.echo(
            f"anti-windup ({windup.strategy}) {acted}: integral {windup.before:.6g} + "
            f"{windup.increment:.6g}, used {windup.used:.6g}, kept {windup.after:.6g} rad s"
        )
    click.echo(
        "recomputed: equal to the recorded command, bit for bit"
        if found.agrees
        else f"recomputed: {terms.effort!r}, but {found.recorded!r} N m is recorded"
        + (", in another arithmetic" if found.rounded_otherwise else "")
    )
