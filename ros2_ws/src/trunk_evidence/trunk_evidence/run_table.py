"""`RunTable`: a run as aligned columns, one row per true state; its metrics."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from trunk_core import topics
from trunk_core.arrays import Floats, Integers
from trunk_core.compiled import twin
from trunk_core.errors import TrunkError
from trunk_core.parameters.declarations import ParameterError, build
from trunk_core.units import NANOSECONDS, seconds
from trunk_recording.joint_table import Column, JointTable
from trunk_recording.reader import RecordingError

from .recorded_run import RecordedRun, joints_of
from .run_metrics import Metrics, Sums, metrics_of, no_rows, steady_from, with_row

if TYPE_CHECKING:
    from .evidence import RecordedInputs

_HELD = ("reference", "kp", "ki", "kd", "alpha")


@dataclass(frozen=True)
class RunTable:
    """Columns [N + 1] at the stamps of the true states; NaN where the run has no value.

    ``torque[k]`` is what was applied over [t_k, t_k+1). Reference and gains are those of the
    controller's last update, at t_k or before. In real time, the reference before the first update is that
    of its parameters, while it was active.
    """

    t: Floats  # s
    x: Floats  # m
    theta: Floats  # rad
    x_dot: Floats  # m/s
    theta_dot: Floats  # rad/s
    theta_measured: Floats  # rad
    reference: Floats  # rad
    torque: Floats  # N m
    kp: Floats  # N m/rad
    ki: Floats  # N m/(rad s)
    kd: Floats  # N m s/rad
    alpha: Floats

    @classmethod
    def from_run(
        cls, run: RecordedRun, only: Collection[str] = ("theta_measured", *_HELD)
    ) -> RunTable:
        """Return a recorded run, matched by stamps. Raises RecordingError without true states.

        ``only`` names what is read besides the true states and the torque; the rest is NaN.
        """
        hip, trunk = joints_of(run)
        states = [topics.controller_state(name) for name in run.controllers]
        held = [name for name in _HELD if name in only]
        series = run.series(cls.needed(run, only))
        truth = series[topics.GROUND_TRUTH]
        at = truth.stamp_ns
        if (count := run.count(topics.GROUND_TRUTH)) > 1 and len(at) == 1:
            raise RecordingError(
                f"{run.path}: {run.topic(topics.GROUND_TRUTH)}: all {count} states have the stamp "
                f"t = {seconds(int(at[0])):.9g} s: no time passes; set header.stamp where they are published"
            )
        nothing = np.broadcast_to(np.nan, at.shape)
        columns = dict.fromkeys(("theta_measured", *_HELD), nothing)
        if held and states:
            terms = {name: series.pop(topics.controller_state(name)) for name in run.controllers}
            for name, (stamps, values) in in_turn(list(terms.values()), held).items():
                columns[name] = held_at(at, stamps, values)
            firsts = {
                int(record.stamp_ns[0]): name
                for name, record in terms.items()
                if len(record.stamp_ns)
            }
            if "reference" in held and firsts:
                first = firsts[min(firsts)]
                columns["reference"] = _before_the_first_update(
                    run, first, at, columns["reference"]
                )
        if "reference" in held and run.external and run.count(topics.REFERENCE):
            topic_reference = series[topics.REFERENCE]
            values = topic_reference.column("position", trunk)
            told = held_at(at, topic_reference.stamp_ns, values)
            own = columns["reference"]  # of a controller of ours, from a branch on
            columns["reference"] = np.where(np.isnan(own), told, own)
        if topics.JOINT_STATES in series:
            measured = series[topics.JOINT_STATES]
            values = measured.column("position", trunk)
            columns["theta_measured"] = matched_at(at, measured.stamp_ns, values)

        # A true state carries the torque of the step before it; only the last step's is missing.
        effort = truth.column("effort", trunk)
        torque = np.append(effort[1:], np.nan)
        # An external node may send more on the topic than the plant accepts.
        command = (
            run.table(topics.EFFORT_COMMAND) if run.external else series.pop(topics.EFFORT_COMMAND)
        )
        torque[-1] = _last_torque(
            run, at, float(effort[-1]), command.stamp_ns, command.column("effort", trunk)
        )
        return cls(
            t=(at - run.begin_ns) / NANOSECONDS,
            x=truth.column("position", hip),
            theta=truth.column("position", trunk),
            x_dot=truth.column("velocity", hip),
            theta_dot=truth.column("velocity", trunk),
            torque=torque,
            **columns,
        )

    @staticmethod
    def needed(
        run: RecordedRun, only: Collection[str] = ("theta_measured", *_HELD)
    ) -> dict[str, list[Column]]:
        """Return the columns of the topics that `from_run` reads. Raises as it does."""
        hip, trunk = joints_of(run)
        held = [("position", name) for name in _HELD if name in only]
        needed: dict[str, list[Column]] = {
            topics.GROUND_TRUTH: [
                ("position", hip),
                ("position", trunk),
                ("velocity", hip),
                ("velocity", trunk),
                ("effort", trunk),
            ]
        }
        if run.external:
            reference = ("position", trunk)
            needed[topics.REFERENCE] = [reference] if "reference" in only else []
        else:
            needed[topics.EFFORT_COMMAND] = [("effort", trunk)]
        if "theta_measured" in only:
            needed[topics.JOINT_STATES] = [("position", trunk)]
        if held:
            needed |= {topics.controller_state(name): list(held) for name in run.controllers}
        return needed

    @classmethod
    def of_run(cls, run: RecordedRun) -> RunTable:
        """Return all columns of a recorded run, ours or another robot's, as far as they are known."""
        return cls.of_another_robot(run) if run.another_robot else cls.from_run(run)

    @classmethod
    def of_another_robot(cls, run: RecordedRun) -> RunTable:
        """Return a run of a robot that is not ours, at the stamps of its states.

        Its angle and rate are as measured, its torque is what was commanded last, 0 before; nothing is
        known of a hip.
        Raises RecordingError and ParameterError for what cannot be read.
        """
        states, commands = run.table(topics.JOINT_STATES), run.table(topics.EFFORT_COMMAND)
        joint = run.config(run.judgeable[0]).joint
        rows, given = states.by_stamp(), commands.by_stamp()
        at, angle = rows.stamp_ns, rows.column("position", joint)
        states_of = [run.joints(topics.controller_state(name)) for name in run.controllers]
        held = {name: held_at(at, *values) for name, values in in_turn(states_of, _HELD).items()}
        nothing = np.full(at.shape, np.nan)
        return cls(
            t=(at - run.begin_ns) / NANOSECONDS,
            x=nothing,
            theta=angle,
            x_dot=nothing,
            theta_dot=rows.column("velocity", joint),
            theta_measured=angle,
            torque=np.nan_to_num(
                held_at(at, given.stamp_ns, given.column("effort", joint)), nan=0.0
            ),
            **held,
        )


def in_turn(
    tables: Sequence[JointTable], names: Collection[str]
) -> dict[str, tuple[Integers, Floats]]:
    """Return positions of several topics, merged by increasing stamp: stamps and values by name."""
    ordered = [table.by_stamp() for table in tables]
    if len(ordered) == 1:  # an hour's columns are not copied
        return {name: (ordered[0].stamp_ns, ordered[0].column("position", name)) for name in names}
    stamp_ns, rows = np.unique(
        np.concatenate([table.stamp_ns for table in ordered]), return_index=True
    )
    return {
        name: (
            stamp_ns,
            np.concatenate([table.column("position", name) for table in ordered])[rows],
        )
        for name in names
    }


TABLE_UNITS = {
    "t": "s",
    "x": "m",
    "theta": "rad",
    "x_dot": "m/s",
    "theta_dot": "rad/s",
    "theta_measured": "rad",
    "reference": "rad",
    "torque": "N m",
    "kp": "N m/rad",
    "ki": "N m/(rad s)",
    "kd": "N m s/rad",
    "alpha": "",
}
COLUMNS = tuple(RunTable.__dataclass_fields__)

# What delays or loses commands; a link with none of these passes all of them on at once.
_OF_LINK = tuple(f"link.command.{name}" for name in ("delay", "jitter", "loss", "burst.begin"))


def held_at(at: Integers, stamps: Integers, values: Floats) -> Floats:
    """Return the last of the values at or before each stamp, NaN before the first."""
    if np.array_equal(at, stamps):
        return values
    rows = np.searchsorted(stamps, at, side="right")
    return np.append(np.nan, values)[rows]


def _before_the_first_update(
    run: RecordedRun, controller: str, at: Integers, reference: Floats
) -> Floats:
    """Return the reference in rad with what the first controller's parameters say before its first update.

    In real time on a busy machine it may answer late. NaN remains where that controller was not active, where
    a reference came by topic, and if its law or its parameters are not known.
    """
    early = at[: np.flatnonzero(~np.isnan(reference))[:1].sum()]
    if run.exact or not len(early) or controller not in run.judgeable:
        return reference
    # Needed only here: without the controllers' package, metrics start sooner.
    from trunk_control.reference import reference_at

    from .evidence import acts

    completed = np.array(reference)
    try:
        timeline = run.timeline(controller)
        for k in np.flatnonzero(acts(run, controller, early)).tolist():
            timeline.advance(int(early[k]))
            if timeline.config.reference_profile == "topic":
                return reference
            completed[k] = reference_at(int(early[k]), timeline.config.reference)
    except TrunkError:  # such as values that cannot be used: what is recorded can still be shown
        return reference
    return completed


def matched_at(at: Integers, stamps: Integers, values: Floats) -> Floats:
    """Return the values at exactly these stamps, NaN where there is none."""
    if np.array_equal(at, stamps):
        return values
    rows = np.searchsorted(stamps, at, side="right")
    present = np.append(-1, stamps)[rows] == at
    return np.where(present, np.append(np.nan, values)[rows], np.nan)


def _last_torque(
    run: RecordedRun, states: Integers, before: float, stamps: Integers, commands: Floats
) -> float:
    """Return the torque over the step from the last of the states, N m, after ``before``.

    It is the command as changed by link and actuator, where the plant's inputs are on record the one in
    force; ``before`` where the record does not show it, and the command itself where the simulator's
    parameters are not on record, or cannot be used.
    """
    stamp_ns = int(states[-1])
    values = dict(run.parameters.get("simulator", {}))
    for change in run.parameter_changes("simulator"):
        if change.stamp_ns < stamp_ns:
            values |= change.changed

    def command(at_ns: int) -> float:
        if run.count(topics.PLANT_INPUTS):
            return float(_inputs(run, states[-1:]).over(slice(None)).command[0])
        return float(matched_at(np.array([at_ns]), stamps, commands)[0])

    limit = values.get("max_effort", inf)
    plain = all(
        value in (0.0, inf)
        for name, value in values.items()
        if name.startswith("actuator.") or name in _OF_LINK
    )
    if plain:  # an ideal drive: the plant need not be loaded
        effort = command(stamp_ns)
        made = min(max(effort, -limit), limit) if isinstance(limit, float) else effort
        return before if np.isnan(effort) else made
    from trunk_runs.nodes import config_class
    from trunk_sim.step import torque_of

    from .evidence import delivered_ns

    try:
        config = build(config_class("simulator", values), values)
    except ParameterError:
        effort = command(stamp_ns)
        return before if np.isnan(effort) else effort
    # What is in force has passed the link.
    sent = int(states[-1] if run.count(topics.PLANT_INPUTS) else delivered_ns(config, states)[-1])
    effort = command(sent) if sent >= 0 else 0.0
    return before if np.isnan(effort) else torque_of(before, effort, config.plant)


# As `trunk_sim.disturbances` and `trunk_control.pid_family` have them: metrics load neither plant nor law.
DISTURBANCE = tuple(
    f"disturbance_{joint}_{what}" for what in ("effort", "position") for joint in ("hip", "trunk")
)
COMMAND = "command"  # a law's term `effort`, which is a metric's name too
UNITS = {
    "error": "rad",
    "error_rate": "rad/s",
    **dict.fromkeys(("p_term", "i_term", "d_term", "unsaturated", COMMAND), "N m"),
}


def terms(run: RecordedRun, table: RunTable) -> dict[str, Floats]:
    """Return the terms that the controllers recorded, by name, of the last update at each state.

    Gains and reference are columns of the table. NaN before the first update, and where the controller that
    acted has no such term.
    """
    states = [topics.controller_state(name) for name in run.controllers]
    states = [state for state in states if run.count(state)]
    recorded = dict.fromkeys(name for state in states for name in run.joint_names(state))
    names = [name for name in recorded if name not in (*COLUMNS, "measurement")]
    if not names:
        return {}
    at = _stamps(run, table)
    columns = [("position", name) for name in names]
    recorded_terms = run.series(dict.fromkeys(states, columns))
    return {
        COMMAND if name == "effort" else name: held_at(at, *values)
        for name, values in in_turn([*recorded_terms.values()], names).items()
    }


def disturbance(run: RecordedRun, table: RunTable) -> dict[str, Floats]:
    """Return the disturbances of hip and trunk at each state: forces, and offsets on the measurement.

    Where the plant's inputs are on record they are what acted, NaN in a state without them.
    """
    at = _stamps(run, table)
    if run.count(topics.PLANT_INPUTS):
        inputs = _inputs(run, at)
        acted = np.where(inputs.command_known, inputs.over(slice(None)).disturbance.T, np.nan)
        return dict(zip(DISTURBANCE, acted, strict=True))
    if not run.count(topics.DISTURBANCE):
        return {name: np.zeros(len(at)) for name in DISTURBANCE}
    acting = run.joints(topics.DISTURBANCE).by_stamp()
    joints = (*acting.names, "", "")[:2]  # of one that is missing nothing is known
    columns = [(kind, joint) for kind in ("effort", "position") for joint in joints]
    return {
        name: matched_at(at, acting.stamp_ns, acting.column(*column))
        for name, column in zip(DISTURBANCE, columns, strict=True)
    }


def _inputs(run: RecordedRun, states: Integers) -> RecordedInputs:
    from .evidence import RecordedInputs  # with the plant: an exact run needs none

    return RecordedInputs(run, states)


def all_columns(run: RecordedRun, table: RunTable) -> dict[str, Floats]:
    """Return the table's columns, then terms and disturbance."""
    own = {name: getattr(table, name) for name in COLUMNS}
    return {**own, **terms(run, table), **disturbance(run, table)}


def column_units(run: RecordedRun) -> dict[str, str]:
    """Return the units of `all_columns` by name: empty for a ratio, none for a term of an unknown law."""
    # Needed only here: without laws and plans, metrics start sooner.
    from trunk_control.laws import law_named
    from trunk_runs.nodes import CONTROLLERS
    from trunk_sim.plants.trunk import PLANT

    known = [law_named(name).units for name in run.controllers if name in CONTROLLERS]
    own = {name: unit for units in known for name, unit in units.items()}
    plant = PLANT
    with suppress(ParameterError, RecordingError):
        plant = run.plant or PLANT
    first = plant.coordinates[0].unit
    units = {**own, **TABLE_UNITS, **UNITS, "x": first, "x_dot": f"{first}/s"}
    units = {name: plant.of_drive(unit) for name, unit in units.items()}
    return units | dict(zip(DISTURBANCE, plant.channel_units.values(), strict=True))


def _stamps(run: RecordedRun, table: RunTable) -> Integers:
    return np.rint(table.t * NANOSECONDS).astype(np.int64) + run.begin_ns


_WORTH_COMPILING = 200_000  # rows: loading the compiler takes as long as summing this many


def metrics(table: RunTable, compiled: bool = False) -> Metrics:
    """Return the metrics of a run; t counts from its first state.

    Overshoot and settling refer to the reference's last level and count from its last change (t_0 if
    it is constant). A reference that still changes in the last second (a sine, or a level set too
    late) has no such level: both are None. The time of a run that never settles is infinite.
    ``compiled``: add up in compiled code, however short the run; the numbers are the same. Raises
    ValueError for a table without rows, or if its data are not finite or make another metric infinite.
    """
    _check(table)
    since_first = table.t - table.t[0]
    end = float(since_first[-1])
    t, theta, reference, torque = (
        np.ascontiguousarray(column)
        for column in (since_first, table.theta, table.reference, table.torque)
    )
    if (compiled or len(t) >= _WORTH_COMPILING) and twin(_sums) is not _sums:
        sums = twin(_sums)(t, theta, reference, torque, steady_from(end))
    else:
        rows = t.tolist(), theta.tolist(), reference.tolist(), torque.tolist()
        sums = _sums(*rows, steady_from(end))
    return metrics_of(sums, 0.0)


def _check(table: RunTable) -> None:
    if not len(table.t):
        raise ValueError("metrics need at least one state; the run has none")
    if np.isnan(table.reference[0]):
        raise ValueError(
            "no controller of ours has published its reference by the first state: no metrics"
        )
    for name in ("t", "theta", "reference", "torque"):
        bad = np.flatnonzero(~np.isfinite(getattr(table, name)))
        if len(bad):
            raise ValueError(f"{name} is not finite at t = {table.t[bad[0]]:g} s: no metrics")


def _sums(
    t: Sequence[float],
    theta: Sequence[float],
    reference: Sequence[float],
    torque: Sequence[float],
    steady: float,
) -> Sums:
    sums = no_rows(t[0])
    for k in range(len(t)):
        sums = with_row(sums, t[k], theta[k], reference[k], torque[k], steady)
    return sums


def keep_for_metrics(run: RecordedRun) -> None:
    """Read what metrics and doubts need in one pass; what cannot be read is reported when it is asked for."""
    with suppress(TrunkError):
        run.keep_series(RunTable.needed(run, ("reference",)))


def table_and_metrics(run: RecordedRun) -> tuple[RunTable, Metrics]:
    """Return a recorded run's table, as far as metrics need it, and its metrics.

    Raises RecordingError if it has none, or cannot be read.
    """
    # Only what metrics need: an hour at 1 kHz then takes a third of a GiB.
    table = RunTable.from_run(run, only=("reference",))
    try:
        return table, metrics(table)
    except ValueError as error:
        raise RecordingError(f"{run.path}: {error}") from None


def recorded_metrics(run: RecordedRun) -> Metrics:
    """Return a recorded run's metrics. Raises RecordingError if it has none, or cannot be read."""
    return table_and_metrics(run)[1]
