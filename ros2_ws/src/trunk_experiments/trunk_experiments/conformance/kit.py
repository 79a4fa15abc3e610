"""What the conformance kits of laws and of plants share: findings, and checks of a plug-in's runs.

Each check is a function of a plug-in that yields findings. A `Kit` applies them by a registered name; the
same checks are test functions for a package's own tests. Runs in CPython, in compiled code and in lanes are
compared bit by bit.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from traceback import extract_tb
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

import numpy as np

from trunk_core.arrays import Floats
from trunk_core.c.types import UntranslatableError
from trunk_core.errors import PlanError, TrunkError
from trunk_core.parameters.declarations import Declaration, declarations
from trunk_core.results import OMITTED, Named
from trunk_evidence.judgement import VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable
from trunk_recording.reader import Recording
from trunk_runs.engine import states_of_run
from trunk_runs.offline_recording import record_offline, record_states
from trunk_runs.plan import RunPlan
from trunk_sim.simulation import DivergedError
from trunk_studies.batch.block import RunSummary, regular_run, run_block, summary_of
from trunk_studies.batch.compiled_run import NotCompiledWarning, Outcome, run_compiled
from trunk_studies.batch.lanes import LANES, TRACED

Plugin = TypeVar("Plugin")


class Finding(NamedTuple):
    """A breach of the contract by a plug-in, or a note about it."""

    function: Annotated[str, "MODULE.FUNCTION"]
    problem: Annotated[str, Named("what"), "With the input that shows it"]
    advice: Annotated[str, "What to do"]
    note: Annotated[bool, "To know, not to mend"] = False
    check: Annotated[str, OMITTED] = ""  # whose it is; filled in by `Check.run`

    def line(self) -> str:
        """Return it as one line."""
        return f"{self.check}: {self.function}: {self.problem}: {self.advice}"


@dataclass(frozen=True)
class Check(Generic[Plugin]):
    """A check: its name, what it asserts, and its function of a plug-in."""

    name: str
    asserts: str
    finds: Callable[[Plugin], Iterator[Finding]]

    def run(self, plugin: Plugin) -> Iterator[Finding]:
        """Yield its findings on a plug-in."""
        return (finding._replace(check=self.name) for finding in self.finds(plugin))


@dataclass(frozen=True)
class Kit(Generic[Plugin]):
    """The checks of a kind of plug-in. ``named``: the registry. ``function``: the one that findings name."""

    noun: str
    named: Callable[[str], Plugin]
    function: Callable[[Plugin], Any]
    checks: Sequence[Check[Plugin]]

    def findings_of(self, name: str, check: Check[Plugin]) -> list[Finding]:
        """Return a check's findings and notes on a registered plug-in.

        Raises KeyError for a name that is not registered, PluginError for what cannot be loaded.
        """
        plugin = self.named(name)
        try:
            return list(check.run(plugin))
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            function = self.function(plugin)
            where, file = name_of(function), function.__code__.co_filename
            lines = [f.lineno for f in extract_tb(error.__traceback__) if f.filename == file]
            if lines:
                where += f", line {lines[-1]}"
            advice = f"a {self.noun} never raises"
            return [Finding(where, f"raises {reason}", advice, check=check.name)]

    def conformance(
        self, name: str, checks: Sequence[Check[Plugin]] | None = None
    ) -> list[Finding]:
        """Return a registered plug-in's breaches of the contract; empty if it conforms, notes left out."""
        return [
            finding
            for check in checks or self.checks
            for finding in self.findings_of(name, check)
            if not finding.note
        ]


def name_of(function: Any) -> str:
    """Return a function's module and name."""
    return f"{function.__module__}.{function.__qualname__}"


def numbers_in(record: Any) -> Iterator[float]:
    """Yield the numbers of a record, nested ones too."""
    if isinstance(record, tuple | list):
        for part in record:
            yield from numbers_in(part)
    elif isinstance(record, int | float):
        yield float(record)


def finite(record: Any) -> bool:
    """Return True if all numbers of a record are finite."""
    return all(map(isfinite, numbers_in(record)))


def own_parameters(config: type[Any], shared: type[Any]) -> dict[str, Declaration]:
    """Return the parameters of a class that ``shared`` does not have, by name."""
    inherited = declarations(shared)
    return {name: d for name, d in declarations(config).items() if name not in inherited}


def bounded(config: type[Any], shared: type[Any]) -> Iterator[Finding]:
    """Yield own parameters of a class without a description, bounds or a unit."""
    for name, declared in own_parameters(config, shared).items():
        where = f"{name_of(config)} {name}"
        if not declared.description.strip():
            yield Finding(where, "has no description", "say in a phrase what it is")
        if isinstance(declared.default, str | bool | tuple) and not isinstance(
            next(iter(numbers_in(declared.default)), None), float
        ):
            continue
        limited_below = declared.minimum is not None or declared.above is not None
        if not declared.unbounded and not (limited_below and declared.maximum is not None):
            yield Finding(where, "has no bounds", "give minimum or above, and maximum")
        if not declared.unit and isinstance(declared.default, float):
            yield Finding(where, "has no unit", "give unit=..., in SI; none for a ratio", note=True)


def fastest_us(call: Callable[[Any], object], inputs: Sequence[Any]) -> float:
    """Return the microseconds of the quickest of many calls."""
    best = float("inf")
    for _ in range(20):
        for given in inputs:
            begun = perf_counter()
            call(given)
            best = min(best, perf_counter() - begun)
    return best * 1e6


def recomputes(plan: RunPlan, where: str, advice: str) -> Iterator[Finding]:
    """Yield a finding where a recorded run differs from its recomputation."""
    with TemporaryDirectory(prefix="trunk-check-") as folder:
        path = Path(folder) / "run.mcap"
        try:
            record_offline(plan, path)
            verdict = verify(Recording.open(path))
        except TrunkError as error:
            yield Finding(where, str(error), "see the other findings")
            return
    if verdict.exit_code != VERIFIED:
        said = "; ".join(verdict.reasons)
        yield Finding(where, f"trunk verify does not verify a run with it: {said}", advice)


_IN_LANES = ("x", "theta", "x_dot", "theta_dot", "reference", "torque")


def first_difference(plan: RunPlan) -> str | None:
    """Return the first difference of a plan's compiled and interpreted runs; None if all bits are equal.

    A plan that both refuse with the same message counts as equal.
    """
    try:
        outcome = run_compiled(plan)
    except PlanError as error:
        return _refusal_difference(plan, str(error))
    diverged = False
    with TemporaryDirectory(prefix="trunk-check-") as folder:
        path = Path(folder) / "run.mcap"
        try:
            record_states(plan, states_of_run(plan, compiled=False), path, tuple(plan.controllers))
        except DivergedError:
            diverged = True
        expected = RunTable.of_run(RecordedRun.open(path))
    if diverged != (outcome.diverged_at is not None):
        return f"{plan.scenario}: diverged: {not diverged} compiled, {diverged} interpreted"
    return column_difference(expected, vars(outcome.table)) or lane_difference(plan, outcome)


def column_difference(expected: RunTable, columns: Mapping[str, Floats]) -> str | None:
    """Return the first difference of some columns from those expected; None if all bits are equal."""
    firsts: list[tuple[int, str]] = []
    for name, column in columns.items():
        wanted = getattr(expected, name)
        if len(column) != len(wanted):
            return f"{len(column)} states, {len(wanted)} expected"
        # Bits of NaN have no meaning.
        wrong = (column.view(np.int64) != wanted.view(np.int64)) & ~(
            np.isnan(column) & np.isnan(wanted)
        )
        firsts += [(int(k), name) for k in np.flatnonzero(wrong)[:1]]
    if not firsts:
        return None
    k, name = min(firsts, key=lambda first: first[0])
    values = (float(columns[name][k]), float(getattr(expected, name)[k]))
    return f"step {k}: {name} is {values[0]!r}, {values[1]!r} expected"


def lane_difference(plan: RunPlan, outcome: Outcome) -> str | None:
    """Return the first difference of a lane and a run of its own; None if all bits are equal.

    Nothing is compared if the run is not regular, or leaves the regular course.
    """
    in_lanes = lane_columns(plan)
    if in_lanes is None:
        return None
    summary, lanes = in_lanes
    for columns in lanes:
        if difference := column_difference(outcome.table, columns):
            return f"{plan.scenario}: in a lane: {difference}"
    alone = summary_of(plan)
    return None if summary == alone else f"{plan.scenario}: {summary} in a lane, {alone} alone"


def lane_columns(plan: RunPlan) -> tuple[RunSummary, list[dict[str, Floats]]] | None:
    """Return the outcome of a run in lanes, and columns of the first lane and the last.

    None if the run is not regular, or leaves the regular course.
    """
    regular = regular_run(plan)
    if regular is None:
        return None
    trace = np.empty((regular.common.states, TRACED, LANES))
    summary = run_block(plan.controller_name, [regular] * LANES, trace)[0]
    if summary is None:
        return None
    return summary, [
        {name: trace[:, row, lane].copy() for row, name in enumerate(_IN_LANES)}
        for lane in (0, LANES - 1)
    ]


def _refusal_difference(plan: RunPlan, reason: str) -> str | None:
    try:
        next(states_of_run(plan, compiled=False))
    except PlanError as error:
        if str(error) == reason:
            return None
        reason = f"{reason!r} compiled, {str(error)!r}"
    return f"{plan.scenario}: refused: {reason} interpreted"


def compiles(plan: RunPlan, where: str, slower: Callable[[], str]) -> Iterator[Finding]:
    """Yield a finding where compiled code differs from CPython; note what numba refuses, and the cost."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        difference = first_difference(plan)
        refused = [w.message for w in caught if isinstance(w.message, NotCompiledWarning)]
        if refused:
            yield Finding(
                where,
                f"not compilable: {refused[0].reason}",
                f"sweeps will use CPython, {slower()}",
                note=True,
            )
    if difference is not None:
        yield Finding(
            where,
            f"compiled code and CPython differ: {difference}",
            "compare with <, >, if; min, max and ** differ for NaN and -0.0",
        )


def untranslated(error: UntranslatableError, refuses: str) -> Finding:
    """Return a note on what the translator to C refuses: function, line and expression, and the cure."""
    return Finding(
        f"{error.function}, line {error.line}",
        f"{error.text}: {error.problem}",
        f"{error.remedy}; until then {refuses}",
        note=True,
    )


ALONE = "until then sweeps make its runs one after another, more slowly"


def runs_in_lanes(plan: RunPlan, where: str) -> Iterator[Finding]:
    """Yield a finding where a run in a lane has other bits than alone; note one that is in no lane."""
    if lane_columns(plan) is None:
        problem = f"the {plan.scenario}'s run leaves its lane: numba refuses it, or it holds"
        yield Finding(where, problem, f"see the other findings; {ALONE}", note=True)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotCompiledWarning)  # `compiles` notes it
        if difference := lane_difference(plan, run_compiled(plan)):
            yield Finding(where, difference, "compare with <, >, if; not with min, max")
