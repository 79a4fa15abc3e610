"""``trunk explain``: why this torque at this instant."""

from __future__ import annotations

from collections.abc import Iterable
from math import degrees, isfinite
from pathlib import Path

import click

from trunk_control.law import OUTCOME
from trunk_evidence.doubts import refused, unsound
from trunk_evidence.evidence import recorded_turns
from trunk_evidence.explanation import Explanation, ExternalCommand, explain, external_command
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import Plant
from trunk_sim.plants.trunk import PLANT

from ..console.document import json_option, write_json
from ..console.options import Number
from ..console.reading import open_run, show_damage
from ..console.tables import print_table
from ..console.terminal import show_warnings

Row = tuple[str, str, str]  # of a table: quantity, value, unit


@click.command("explain")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--at",
    type=Number("s"),
    required=True,
    metavar="S",
    help="The instant, s; for another robot, counted from its first state.",
)
@json_option(Explanation, ExternalCommand)
@click.pass_context
def command(ctx: click.Context, run: Path, at: float, as_json: bool) -> None:
    """Explain why the controller of a recorded run commanded this torque at this instant.

    Exit code 0: the recomputed command equals the recorded one, or differs only by rounding, because it was
    recorded in another arithmetic; 1: it differs.
    """
    recorded = open_run(run)
    show_damage(recorded)
    show_warnings((*unsound(recorded), *refused(recorded)))
    turns = reversed(recorded_turns(recorded) if recorded.external else ())
    theirs = recorded.external
    if theirs and next((who for start, who in turns if start <= at), theirs) == theirs:
        known = external_command(recorded, at)
        if as_json:
            write_json(known)
        else:
            _show_external(known, recorded.plant or PLANT)
        return
    explanation = explain(recorded, at)
    if as_json:
        write_json(explanation)
    else:
        _show(explanation, recorded.plant or PLANT)
    ctx.exit(0 if explanation.agrees or explanation.rounded_otherwise else 1)


def _show_external(known: ExternalCommand, plant: Plant) -> None:
    """Print what is known of an external controller's command."""
    terms = "" if known.terms else "; its terms were not recorded"
    if known.command is None:
        click.echo(f"t = {known.asked_s:g} s: no command of {known.controller} is in force{terms}")
    else:
        answers = "acts since it arrived" if known.arrived else f"answers t = {known.answers_s:g} s"
        click.echo(
            f"t = {known.asked_s:g} s: {plant.of_drive('torque')} from {known.controller}: "
            f"{known.command:.6g} {plant.driven.effort_unit}, {answers}{terms}"
        )
    rows = [
        ("reference", f"{degrees(known.reference):.6g}", "°"),
        ("measured angle", f"{degrees(known.measurement):.6g}", "°"),
        ("true angle", f"{degrees(known.true_angle):.6g}", "°"),
        ("error e", f"{degrees(known.reference - known.true_angle):.6g}", "°"),
        *_disturbance_rows(known.disturbance, plant),
        *_of_drive([("torque applied to the plant", f"{known.applied:.6g}", "N m")], plant),
    ]
    print_table("what is known", ("quantity", "value", "unit"), rows)
    if known.terms:
        named = [(name, f"{value:.6g}", "") for name, value in known.terms.items()]
        print_table(f"terms of {known.controller}, as it names them", ("term", "value", ""), named)


def _of_drive(rows: Iterable[Row], plant: Plant) -> list[Row]:
    """Return rows about the drive in the words of a plant."""
    return [(plant.of_drive(what), value, plant.of_drive(unit)) for what, value, unit in rows]


def _disturbance_rows(acting: Disturbance, plant: Plant) -> list[Row]:
    kinds = {"N": "force", "N m": "torque"}
    rows = [
        (
            f"disturbance: {channel.rpartition('_')[0]} {kinds.get(unit, 'offset')}",
            f"{degrees(value) if unit == 'rad' else value:.6g}",
            "°" if unit == "rad" else unit,
        )
        for value, (channel, unit) in zip(acting, plant.channel_units.items(), strict=True)
        if value
    ]
    return rows or [("disturbance", "none", "")]


def _shares(explanation: Explanation) -> list[Row]:
    """Return the rows of the terms that a law of the PID's kind adds up."""
    terms = explanation.terms
    fed = [p for p in explanation.hip if p.gain]
    return [
        ("P: Kp e", f"{terms.p_term:.6g}", "N m"),
        ("I: Ki times the integral", f"{terms.i_term:.6g}", "N m"),
        ("D: Kd times the derivative", f"{terms.d_term:.6g}", "N m"),
        *(
            [("besides P, I and D", f"{explanation.by_model:.6g}", "N m")]
            if explanation.by_model or fed
            else []
        ),
        *((f"  -K{p.symbol} {p.symbol}: {p.quantity}", f"{p.share:.6g}", "N m") for p in fed),
        ("their sum", f"{terms.unsaturated:.6g}", "N m"),
    ]


def _gains(explanation: Explanation) -> list[Row]:
    """Return the rows of its gains."""
    terms = explanation.terms
    defined = terms.alpha or terms.ki * terms.kd > 0.0
    return [
        ("Kp", f"{terms.kp:.6g}", "N m/rad"),
        ("Ki", f"{terms.ki:.6g}", "N m/(rad s)"),
        ("Kd", f"{terms.kd:.6g}", "N m s/rad"),
        *((f"K{p.symbol}", f"{p.gain:.6g}", p.gain_unit) for p in explanation.hip if p.gain),
        ("alpha = Kp^2 / (Ki Kd)", f"{terms.alpha:.6g}" if defined else "–", ""),
    ]


def _own_terms(explanation: Explanation, plant: Plant) -> list[Row]:
    """Return the rows of another law's terms, as it names them, in the units of a plant."""
    named = [name for name in explanation.terms._fields if name not in OUTCOME]
    rows = [
        (
            name.replace("_", " "),
            f"{getattr(explanation.terms, name):.6g}",
            plant.of_drive(explanation.units.get(name, "")),
        )
        for name in named
    ]
    unit = plant.driven.effort_unit
    return [*rows, ("command before the limits", f"{explanation.terms.unsaturated:.6g}", unit)]


def _show(explanation: Explanation, plant: Plant) -> None:
    terms, windup = explanation.terms, explanation.anti_windup
    unit = plant.driven.effort_unit
    click.echo(
        f"t = {explanation.asked_s:g} s: {explanation.controller} holds {terms.effort:.6g} {unit}, "
        f"computed at t = {explanation.update_s:g} s"
    )
    truth = ("not known: another robot", "")
    if explanation.true_angle is not None:
        truth = (f"{degrees(explanation.true_angle):.6g}", "°")
    rate = ("measured rate", f"{explanation.rate:.6g}", "rad/s")
    if windup is not None:
        mode = explanation.derivative_mode
        rate = (f"its derivative (mode {mode})", f"{terms.error_rate:.6g}", "rad/s")
    rows = [
        ("reference", f"{degrees(explanation.reference):.6g}", "°"),
        ("measured angle", f"{degrees(explanation.measurement):.6g}", "°"),
        ("true angle", *truth),
        ("error e", f"{degrees(explanation.error):.6g}", "°"),
        rate,
        *((p.quantity, f"{p.value:.6g}", p.unit) for p in explanation.hip),
        *_disturbance_rows(explanation.disturbance, plant),
    ]
    print_table("inputs", ("quantity", "value", "unit"), rows)
    if explanation.rules:
        symbols = (c.symbol for c in explanation.rules[0].consequents)
        print_table(
            "rules that fired",
            ("if e is", "and e_dot is", "weight", *symbols),
            [
                (
                    rule.error_label,
                    rule.rate_label,
                    f"{rule.weight:.6f}",
                    *(f"{c.label} = {c.value:.6g}" for c in rule.consequents),
                )
                for rule in explanation.rules
                if rule.weight > 0.0
            ],
        )
        for table, cells in explanation.changed_tables.items():
            click.echo(f"{table}, from the default: {cells}")
        if explanation.changed_tables:
            click.echo()
    low, high = explanation.limits
    limits = ("none", "")
    if isfinite(low) or isfinite(high):
        limits = (f"{low:g} … {high:g}", "N m")
    applied: Row = ("torque applied to the robot", "not known", "")
    if explanation.applied is not None:
        applied = ("torque applied to the plant", f"{explanation.applied:.6g}", "N m")
    outcome = [
        ("limits of the handover" if explanation.handing_over else "limits", *limits),
        ("command" + ", limited" * explanation.limited, f"{terms.effort:.6g}", "N m"),
        applied,
    ]
    if windup is None:
        rows = [*_own_terms(explanation, plant), *_of_drive(outcome, plant)]
    else:
        rows = _of_drive([*_shares(explanation), *outcome, *_gains(explanation)], plant)
    print_table("outputs", ("quantity", "value", "unit"), rows)
    if explanation.took_over:
        click.echo(
            plant.of_drive(
                f"{explanation.controller} took over here: it continued from the torque that acted, "
                "without a jump"
            )
        )
    if windup is not None:
        acted = "acted" if windup.acted else "did not act"
        click.echo(
            f"anti-windup ({windup.strategy}) {acted}: integral {windup.before:.6g} + "
            f"{windup.increment:.6g}, used {windup.used:.6g}, kept {windup.after:.6g} rad s"
        )
    click.echo(
        "recomputed: equal to the recorded command, bit for bit"
        if explanation.agrees
        else f"recomputed: {terms.effort!r}, but {explanation.recorded!r} {unit} is recorded"
        + (", in another arithmetic" if explanation.rounded_otherwise else "")
    )
