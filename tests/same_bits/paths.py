"""The paths by which a plan is run, each compared with its run by CPython bit by bit.

A path yields recordings, or columns of a `RunTable`; `differences` compares them all in one way.
"""

import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from ros2_ws.src.trunk_recording.test.mcap_files import content
from ros2_ws.src.trunk_studies.test.cpp_device import CppDevice, kernel_and_words, summary_in

from trunk_core import topics
from trunk_core.arrays import Floats
from trunk_core.units import seconds
from trunk_evidence.branching import Branch, branch_plan, record_branch
from trunk_evidence.differences import diff
from trunk_evidence.judgement import VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable, metrics
from trunk_experiments.conformance.kit import column_difference, lane_columns
from trunk_recording import writer
from trunk_runs import engine
from trunk_runs.engine import states_of_run
from trunk_runs.graph import run_graph
from trunk_runs.offline_recording import record_offline, record_states
from trunk_runs.plan import RunPlan
from trunk_runs.run_files import RunFiles
from trunk_sim.simulation import DivergedError
from trunk_studies.batch.block import RunSummary, summary_of
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.batch.kernel import fitted

from ..exported.loops import table_in_c

Columns = Mapping[str, Floats]
Made = RecordedRun | Columns | RunSummary
Repeats = Callable[[RunPlan, RecordedRun, Path, int], Iterator[Made]]


def reference(plan: RunPlan, folder: Path) -> RecordedRun:
    """Record a plan's run by CPython; one that diverges ends with its last finite state."""
    path = folder / "cpython.mcap"
    with suppress(DivergedError):
        interpreted = states_of_run(plan, compiled=False)
        record_states(plan, interpreted, path, tuple(plan.controllers), overwrite=True)
    return RecordedRun.open(path)


def _recorded(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RecordedRun]:
    """The run itself, which must verify."""
    yield run


def _compiled(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RecordedRun]:
    """Segment by segment, as an offline run that is worth compiling."""
    path = folder / "compiled.mcap"
    with suppress(DivergedError):
        compiled = states_of_run(plan, compiled=True)
        record_states(plan, compiled, path, tuple(plan.controllers), overwrite=True)
    yield RecordedRun.open(path)


def _stretches(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RecordedRun]:
    """In stretches of 70 states, and several chunks in one; CPython's code must not be called."""
    with (
        patch.object(engine, "longest", lambda substeps: 70),
        patch.object(writer, "CHUNK_SIZE", 30_000),
        patch.object(engine, "_plain_code", None),
    ):
        (made,) = _compiled(plan, run, folder, seed)
    assert content(made.path).messages == content(run.path).messages
    yield made


def _like(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RecordedRun]:
    """From the recording: `trunk simulate --like`, which leaves out a controller that never acted."""
    if set(plan.controllers) - set(run.controllers):
        return
    record_offline(run.plan(), folder / "like.mcap", overwrite=True)
    yield RecordedRun.open(folder / "like.mcap")


def _branch(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RecordedRun]:
    """Branches without a change, from the first state and from two others."""
    random_ = random.Random(seed)
    for at in (0.0, random_time(run, random_), random_time(run, random_)):
        yield branched_at(run, Branch(at), folder / "branch.mcap")


def random_time(run: RecordedRun, random_: random.Random) -> float:
    """Return a random time within a run, s; one time in fifty it is an end of the run."""
    last = seconds(int(run.table(topics.GROUND_TRUTH).stamp_ns.max()))
    return random_.choice((0.0, last)) if random_.random() < 0.02 else random_.uniform(0.0, last)


def branched_at(run: RecordedRun, branch: Branch, path: Path) -> RecordedRun:
    """Record a branch of a run."""
    record_branch(run, branch, branch_plan(run, branch), path, overwrite=True)
    return RecordedRun.open(path)


def _batch(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[Made]:
    """In one compiled call."""
    yield vars(run_compiled(plan).table)
    yield summary_of(plan)


def _lanes(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[Made]:
    """In the first lane of a block and in its last."""
    if in_lanes := lane_columns(plan):
        summary, lanes = in_lanes
        yield from (summary, *lanes)


def _kernel(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RunSummary]:
    """By two threads of a kernel."""
    if not isinstance(fitted(plan), str):
        outcomes = CppDevice(folder).run(*kernel_and_words([plan, plan]))
        yield from (summary_in(outcomes, thread) for thread in range(2))


def _c(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[Columns]:
    """The whole loop as C, of a plan that nobody changes by hand."""
    if plan.changes or plan.references:
        return
    table, _ = table_in_c(plan, folder)
    names = [name for name in RunTable.__dataclass_fields__ if name != "t"]
    yield dict(zip(names, table, strict=True))


def _graph(composed: bool) -> Repeats:
    """By the real nodes in lock-step, begun in any order."""

    def path(plan: RunPlan, run: RecordedRun, folder: Path, seed: int) -> Iterator[RecordedRun]:
        order = list(plan.configs)
        random.Random(seed).shuffle(order)
        with TemporaryDirectory(dir=folder) as name:
            files = RunFiles(Path(name) / "graph")
            run_graph(plan, files, lambda _: None, order=order, composed=composed)
            yield RecordedRun.open(files.recording)

    return path


IN_ONE_PROCESS: dict[str, Repeats] = {
    "recorded": _recorded,
    "compiled": _compiled,
    "stretches": _stretches,
    "like": _like,
    "branch": _branch,
    "batch": _batch,
    "lanes": _lanes,
    "kernel": _kernel,
    "c": _c,
}
PATHS = IN_ONE_PROCESS | {"composed": _graph(True), "processes": _graph(False)}


def differences(
    path: str, plan: RunPlan, run: RecordedRun, folder: Path, seed: int = 0
) -> list[str] | None:
    """Return how a plan's runs by a path differ from the recorded one; None for a path that makes none."""
    made = 0
    found: list[str] = []
    for other in PATHS[path](plan, run, folder, seed):
        made += 1
        found += difference(run, other)
    return found if made else None


def _summary(run: RecordedRun) -> RunSummary:
    """Return the outcome of a recorded run."""
    table, fell = RunTable.of_run(run), run.fall is not None
    if not run.recording.complete:
        return RunSummary(None, float(table.t[-1]), fell=fell)
    return RunSummary(metrics(table), fell=fell)


def difference(run: RecordedRun, other: Made) -> list[str]:
    """Return in what a run differs from one by CPython; nothing if all bits are equal."""
    if isinstance(other, RunSummary):
        expected = _summary(run)
        return [] if repr(other) == repr(expected) else [f"{other}, {expected} expected"]
    if not isinstance(other, RecordedRun):
        line = column_difference(RunTable.of_run(run), other)
        return [line] if line else []
    compared = diff(run, other)
    lines = [] if compared.identical else [compared.describe()]
    if compared.compared < 3 * run.count(topics.GROUND_TRUTH):
        lines.append(f"only {compared.compared} messages compared")
    # A run that ended early is repeated for as long as it was; a graph's recorder has events of its own.
    length, recorder = "simulator: duration: ", "recorder: only in "
    lines += [line for line in compared.parameters if not line.startswith((length, recorder))]
    if not any(line.startswith(recorder) for line in compared.parameters):
        lines += compared.record
        for topic in (topics.RUN_EVENTS, topics.RUN_PARAMETERS):
            if run.count(topic) != other.count(topic):
                lines.append(f"{topic}: {run.count(topic)} messages, {other.count(topic)}")
    verdict = verdict_on(other)
    if verdict.exit_code != VERIFIED and run.recording.complete:
        lines.append(f"{verdict.word}: {'; '.join(verdict.reasons)}")
    return lines
