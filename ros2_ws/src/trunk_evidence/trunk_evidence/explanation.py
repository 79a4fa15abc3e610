"""Why this torque at this instant: one update of a recorded controller, recomputed term by term."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isclose
from typing import Annotated, NamedTuple

import numpy as np

from trunk_control.decide import transfer_limits
from trunk_control.law import ControllerConfig, Hip, LawMemory, LawTerms, Limits, limited
from trunk_control.laws import law_named
from trunk_control.pid_family import Terms
from trunk_control.rule_base import RuleBaseConfig
from trunk_core import topics
from trunk_core.parameters.declarations import ParameterError
from trunk_core.results import ALSO, OMITTED, As, Keyword, Known, known
from trunk_core.units import nanoseconds, seconds
from trunk_msgs_util.source import ARRIVAL
from trunk_recording.provenance import ARITHMETIC
from trunk_recording.reader import RecordingError
from trunk_runs.nodes import CONTROLLERS, unknown_controllers
from trunk_sim.disturbances import Disturbance
from trunk_sim.inputs import with_operator
from trunk_sim.plant import Plant
from trunk_sim.plants.trunk import PLANT

from .doubts import RecordingResult, about
from .evidence import RecordedInputs, recorded_turns
from .judgement import robot_obstacles
from .parameter_text import change_text
from .recorded_run import RecordedRun
from .rerun import Rerun
from .run_table import RunTable
from .verdict import same


class Consequent(NamedTuple):
    """What a rule says of one output."""

    output: str  # kp, kd, alpha
    symbol: str
    label: str  # or number, as the table has it
    value: float


class Rule(NamedTuple):
    """A rule that fired: its labels, its weight, and its consequents."""

    error_label: str
    rate_label: str
    weight: float
    consequents: tuple[Consequent, ...]


class Windup(NamedTuple):
    """The integral in rad s: before the update, its increment, as used, and as kept afterwards."""

    strategy: str
    before: float
    increment: float
    used: float
    after: float

    @property
    def acted(self) -> Annotated[bool, ALSO]:
        """True if anti-windup changed the integral after the command was computed."""
        return not same(self.after, self.used)


class Feedback(NamedTuple):
    """Position or rate of a law's `hip_joint`, as measured, and what it asks for: ``-gain value``."""

    quantity: str
    symbol: str  # x or v
    value: float
    unit: str
    gain: float  # 0: none
    gain_unit: str
    share: float  # in the unit of the command


def _flat(rules: Sequence[Rule]) -> list[dict[str, str | float]]:
    """Return rules as JSON has them: ``kp_label``, ``kp`` and so on for each output."""
    flat: list[dict[str, str | float]] = []
    for error, rate, weight, consequents in rules:
        named: dict[str, str | float] = {"error_label": error, "rate_label": rate, "weight": weight}
        for c in consequents:
            named |= {f"{c.output}_label": c.label, c.output: c.value}
        flat.append(named)
    return flat


_RULE = Keyword("required", ("error_label", "rate_label", "weight"))
_RULES = As(list[Annotated[Mapping[str, str | float], _RULE]], _flat)
_LIMITS = As(tuple[float | None, float | None], lambda limits: tuple(map(known, limits)))
_TERMS = As(
    Annotated[Mapping[str, float | bool], Keyword("required", ("unsaturated", "effort", "held"))],
    lambda terms: terms._asdict(),
)


@dataclass(frozen=True)
class Explanation(RecordingResult, document="explain-1"):
    """The document of ``trunk explain``: one update of a controller, its inputs, each term, its output.

    SI units and radians.
    """

    asked_s: float
    update_s: Annotated[float, "When the command in force was computed"]
    controller: str
    reference: Annotated[float, "rad"]
    measurement: Annotated[float, "rad, as the controller saw it"]
    rate: Annotated[float, "rad/s, as measured"]
    true_angle: Annotated[float | None, "rad; null on another robot"]
    derivative_mode: str
    disturbance: Annotated[Disturbance, "N, N m, m, rad; with what an operator does"]
    rules: Annotated[tuple[Rule, ...], _RULES, "That fired; empty for a law without"]
    changed_tables: Annotated[Mapping[str, str], "Cells of rule tables that are not the defaults"]
    terms: Annotated[LawTerms, _TERMS, "As the law names them on ~/state; effort: after the limits"]
    units: Annotated[Mapping[str, str], "Of the terms"]
    by_model: Annotated[float, "N m, what a law adds to P, I and D, from a model or the hip"]
    hip: Annotated[tuple[Feedback, ...], "Parts of by_model; empty: the law does not use it"]
    limits: Annotated[tuple[float, float], _LIMITS, "N m, in force at the update; null: none"]
    limited: Annotated[bool, "The limits changed the command"]
    handing_over: Annotated[bool, "The limits are a handover's, around the torque that acted"]
    anti_windup: Annotated[Windup | None, "rad s; null: the law is not of the PID's kind"]
    took_over: Annotated[bool, "While the plant moved, from the torque that acted"]
    recorded: Annotated[float, "The recorded command, N m"]
    agrees: Annotated[bool, "It equals the recomputed one, bit for bit"]
    arithmetic: Annotated[str | None, "In which it was recorded; null: not known"]
    rounded_otherwise: Annotated[bool, "The other arithmetic can explain the difference"]
    applied: Annotated[float | None, "N m, over the step that begins then; null: not known"]

    @property
    def error(self) -> float:
        """Reference minus measurement, in rad."""
        return self.reference - self.measurement


class _Update(NamedTuple):
    stamp_ns: int
    before: LawMemory
    after: LawMemory
    reference: float
    terms: LawTerms
    measurement: float
    rate: float
    dt: float
    config: ControllerConfig
    took_over: bool  # from another controller, to whose torque the integral was set
    handing_over: bool
    hip: Hip
    law: Limits  # with the limits in force


def explain(run: RecordedRun, at: float) -> Explanation:
    """Return the explanation of the command in force at a time in s.

    Raises RecordingError if the run has no such command or its controller is unknown.
    """
    try:
        return _explain(run, at)
    except ParameterError as error:
        why = f"recorded parameters cannot be used: {error}"
        raise RecordingError(f"{run.path}: {why}") from None


def _explain(run: RecordedRun, at: float) -> Explanation:
    names = [name for name in run.controllers if name in CONTROLLERS]
    if not names:
        raise RecordingError(
            f"{run.path}: there is no torque to explain: "
            f"{unknown_controllers(run.controllers) or 'no controller was recorded'}"
        )
    for name in names:
        if name not in run.parameters:
            raise RecordingError(f"{run.path}: no parameters of {name} recorded: record them too")
    ours = not run.another_robot
    table = RunTable.from_run(run, only=()) if ours else RunTable.of_another_robot(run)
    if not table.t[0] <= at <= table.t[-1]:
        raise RecordingError(
            f"{run.path} lasts from t = {table.t[0]:g} s to t = {table.t[-1]:g} s: "
            f"give --at a time in it, not {at:g}"
        )
    for reason in () if ours else robot_obstacles(run):
        raise RecordingError(f"{run.path}: {reason}")
    rerun = Rerun(run)
    commands = run.table(topics.EFFORT_COMMAND)
    # If several took turns: the one that updated last.
    at_ns = run.begin_ns + nanoseconds(at)
    last = {name: answer.last_update(at_ns) for name, answer in rerun.answers.items()}
    if max(last.values(), default=-1) < 0:
        raise RecordingError(
            f"{run.path}: {' or '.join(names)} had not answered any state by t = {at:g} s: "
            "give --at a later time"
        )
    name = max(last, key=lambda candidate: last[candidate])
    until_ns = rerun.answers[name].process.until_ns
    if until_ns is not None and until_ns <= at_ns:
        since = f"t = {seconds(until_ns - run.begin_ns):g} s"
        raise RecordingError(
            f"{run.path}: another process of {name} acts from {since} on, which is not explained: give --at "
            "a time before that"
        )
    update = _update(rerun, name, last[name])
    acted = [turn.controller for turn in recorded_turns(run) if turn.start <= at]
    if acted and (unknown := unknown_controllers(acted[-1:])):
        raise RecordingError(f"{run.path}: at t = {at:g} s {acted[-1]} acted: {unknown}")
    row = max(0, int((table.t <= at).sum()) - 1)
    updated = seconds(update.stamp_ns - run.begin_ns)
    at_update = max(0, int((table.t <= updated).sum()) - 1)
    terms, config = update.terms, update.config
    recorded = commands.get(update.stamp_ns, "effort", 1)[0]
    agrees = same(terms.effort, recorded)
    near = isclose(terms.effort, recorded, rel_tol=1e-9, abs_tol=1e-9)
    by_model = 0.0
    if isinstance(terms, Terms):
        by_model = terms.unsaturated - (terms.p_term + terms.i_term + terms.d_term)
    return Explanation(
        **vars(about(run)),
        asked_s=at,
        update_s=updated,
        controller=name,
        reference=update.reference,
        measurement=update.measurement,
        rate=update.rate,
        derivative_mode=config.derivative_mode,
        terms=terms,
        units=law_named(name).units,
        rules=_rules(terms, config) if isinstance(config, RuleBaseConfig) else (),
        changed_tables=_changed_tables(config) if isinstance(config, RuleBaseConfig) else {},
        by_model=by_model,
        hip=() if config.hip is None else _of_hip(config, update.hip, run.plant or PLANT),
        limits=(update.law.u_min, update.law.u_max),
        limited=not same(terms.unsaturated, terms.effort),
        handing_over=update.handing_over,
        anti_windup=_windup(update) if isinstance(terms, Terms) else None,
        disturbance=with_operator(
            rerun.acting_at(update.stamp_ns), run.operated.at(update.stamp_ns)
        ),
        true_angle=float(table.theta[at_update]) if ours else None,
        took_over=update.took_over,
        recorded=recorded,
        agrees=agrees,
        arithmetic=run.arithmetic or None,
        rounded_otherwise=near and not agrees and run.arithmetic != ARITHMETIC,
        applied=float(table.torque[row]) if ours else None,
    )


def _update(rerun: Rerun, name: str, stamp_ns: int) -> _Update:
    """Return a controller's update on the state with this stamp, after all that came before it.

    Raises RecordingError if there is no command, or if it does not follow from the record.
    """
    reading = rerun.reading(name, stamp_ns)
    given = stamp_ns in rerun.run.table(topics.EFFORT_COMMAND)
    if not given or reading is None or not rerun.run_to(name, stamp_ns):
        at = seconds(stamp_ns - rerun.run.begin_ns)
        raise RecordingError(
            f"{rerun.run.path}: the command at t = {at:g} s, and what it follows from, are not all on record "
            "(trunk verify says why): give --at a time before that"
        )
    controller = rerun.engine.controllers[name]
    config, before = controller.config, controller.memory
    pending, _, transferring, effort = controller.state.transfer
    if pending:
        transferring, effort = True, limited(reading.effort, config.limits)
    answer = controller.decide(reading)
    return _Update(
        stamp_ns,
        before,
        controller.memory,
        answer.reference,
        answer.terms,
        reading.position,
        reading.velocity,
        controller.state.sample.dt,
        config,
        pending,
        transferring,
        reading.hip,
        transfer_limits(config.limits, effort, config.handover_step)
        if transferring
        else config.limits,
    )


def _rules(terms: LawTerms, config: RuleBaseConfig) -> tuple[Rule, ...]:
    axes, tables = config.axes, config.tables
    rules = []
    for fired in config.fired(terms.error, terms.error_rate):
        row, column = fired.row, fired.column
        consequents = tuple(
            Consequent(table.name, table.symbol, table.cells[row][column], value)
            for table, value in zip(tables, fired.values, strict=True)
        )
        rules.append(Rule(axes.error[row], axes.rate[column], fired.weight, consequents))
    return tuple(sorted(rules, key=lambda rule: -rule.weight))


def _changed_tables(config: RuleBaseConfig) -> dict[str, str]:
    axes = config.axes
    pairs = zip(config.tables, type(config)().tables, strict=True)
    return {
        f"rules.{now.name}": change_text(usual.rows, now.rows, axes)
        for now, usual in pairs
        if now.rows != usual.rows
    }


def _of_hip(config: ControllerConfig, hip: Hip, plant: Plant) -> tuple[Feedback, ...]:
    unit, per = plant.coordinates[config.hip == config.joint].unit, plant.of_drive
    (q, rate), (kx, kv) = hip, config.hip_gains
    of_x, of_v = per(f"N m/{unit}"), per(f"N m s/{unit}")
    return (  # 0 - ...: never -0
        Feedback(f"{config.hip} position", "x", q, unit, kx, of_x, 0.0 - kx * q),
        Feedback(f"{config.hip} rate", "v", rate, f"{unit}/s", kv, of_v, 0.0 - kv * rate),
    )


def _windup(update: _Update) -> Windup:
    terms = update.terms
    before, increment = update.before.integral, update.dt * terms.error
    if update.took_over and terms.ki:
        before = terms.i_term / terms.ki - increment
    used = before + increment
    limits = update.config.limits
    if terms.ki and terms.i_term in (limits.i_min, limits.i_max):
        used = terms.i_term / terms.ki
    strategy = update.config.antiwindup_strategy
    return Windup(strategy, before, increment, used, update.after.integral)


def _known(terms: Mapping[str, float]) -> dict[str, float | None]:
    return {name: known(value) for name, value in terms.items()}


_EXTERNAL_TERMS = As(Mapping[str, float | None], _known)


@dataclass(frozen=True)
class ExternalCommand(RecordingResult, document="explain-external-1"):
    """The document of ``trunk explain`` for an external controller: a command, and what it answers.

    SI units and radians; NaN: not on record.
    """

    asked_s: float
    controller: Annotated[str, "What the run goes by"]
    command: Annotated[float | None, "N m; null: none was in force"]
    answers_s: Annotated[float | None, "The state that it answers; null: it acts from its arrival"]
    arrived: Annotated[bool, OMITTED]  # True: its stamp is no state's
    reference: Annotated[Known, "rad"]
    measurement: Annotated[Known, "rad"]
    true_angle: Annotated[Known, "rad"]
    disturbance: Annotated[Disturbance, "N, N m, m, rad"]
    applied: Annotated[Known, "N m, to the plant over the step that begins then"]
    terms: Annotated[Mapping[str, float], _EXTERNAL_TERMS, "By the node's own names; empty: none"]


def external_command(run: RecordedRun, at: float) -> ExternalCommand:
    """Return the command in force at a time in s, with its context. Raises RecordingError outside the run."""
    table = RunTable.from_run(run)
    if not table.t[0] <= at <= table.t[-1]:
        raise RecordingError(
            f"{run.path} lasts from t = {table.t[0]:g} s to t = {table.t[-1]:g} s: "
            f"give --at a time in it, not {at:g}"
        )
    row = max(0, int((table.t <= at).sum()) - 1)
    stamp_ns = run.begin_ns + nanoseconds(float(table.t[row]))
    inputs = RecordedInputs(run, np.array([stamp_ns]))
    force = inputs.over(slice(None))
    command_ns = int(force.command_ns[0])
    arrived = inputs.sources[int(force.command_source[0])] == ARRIVAL
    return ExternalCommand(
        **vars(about(run)),
        asked_s=at,
        controller=run.external,
        command=float(force.command[0]) if command_ns >= 0 else None,
        answers_s=None if arrived or command_ns < 0 else seconds(command_ns),
        arrived=arrived,
        reference=float(table.reference[row]),
        measurement=float(table.theta_measured[row]),
        true_angle=float(table.theta[row]),
        disturbance=Disturbance(*force.disturbance[0].tolist()),
        applied=float(table.torque[row]),
        terms=_terms(run, command_ns),
    )


def _terms(run: RecordedRun, stamp_ns: int) -> dict[str, float]:
    """Return the terms that an external node has published for a state."""
    for name in run.controllers:
        table = run.table(topics.controller_state(name))
        if name not in run.parameters and stamp_ns in table:
            return dict(zip(table.names, table.get(stamp_ns, "position"), strict=True))
    return {}
