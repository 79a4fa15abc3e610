"""Checks of whole runs with a law: recomputed from the recording, and compiled."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

from trunk_control.law import Law
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.recording.reader import Recording

from ..plans.plan import RunPlan, make_plan
from .finding import LawFinding, name_of

_SHORT = ("simulator.duration=2.0",)


def short_plan(law: Law) -> RunPlan:
    """Return the demo's run with this law, of some seconds."""
    return make_plan("demo", law.name, settings=_SHORT)


def recomputes(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where a recorded run differs from its recomputation."""
    from ..replay.verify import VERIFIED, verify
    from ..runs.offline_recording import record_offline

    with TemporaryDirectory(prefix="trunk-check-") as folder:
        path = Path(folder) / "run.mcap"
        try:
            record_offline(short_plan(law), path)
            verdict = verify(Recording.open(path))
        except TrunkError as error:
            yield LawFinding("replay", name_of(law.update), str(error), "see the other findings")
            return
    if verdict.exit_code != VERIFIED:
        said = "; ".join(verdict.reasons)
        yield LawFinding(
            "replay",
            name_of(law.update),
            f"trunk verify does not verify a run with it: {said}",
            "keep everything that decides a command in memory, sample and parameters",
        )


def compiles(law: Law) -> Iterator[LawFinding]:
    """Yield a finding where compiled code differs from CPython; note what numba refuses."""
    from ..batch.check import first_difference
    from ..batch.compiled_run import Batch

    plan, update = short_plan(law), name_of(law.update)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        difference = first_difference(plan, Batch())
        refused = [
            str(warning.message) for warning in caught if "not compilable" in str(warning.message)
        ]
        if refused:
            factor = _seconds(plan) / max(_seconds(make_plan("demo", "pid", settings=_SHORT)), 1e-9)
            reason = refused[0].split("runs it: ", 1)[-1]
            yield LawFinding(
                "compiled",
                update,
                f"not compilable: {reason}",
                f"sweeps will use CPython, {factor:.0f} times slower",
                note=True,
            )
    if difference is not None:
        yield LawFinding(
            "compiled",
            update,
            f"compiled code and CPython differ: {difference}",
            "compare with <, >, if; min, max and ** differ for NaN and -0.0",
        )


def exports(law: Law) -> Iterator[LawFinding]:
    """Note what the translator to C refuses: its function, line and expression, and what to write instead."""
    from ..export_c.controller import ExportedController
    from ..export_c.types import UntranslatableError

    try:
        ExportedController(law, law.config())
    except UntranslatableError as error:
        yield LawFinding(
            "exportable",
            f"{error.function}, line {error.line}",
            f"{error.text}: {error.problem}",
            f"{error.remedy}; until then there is no trunk export-c of it",
            note=True,
        )


def _seconds(plan: RunPlan) -> float:
    from ..batch.compiled_run import Batch

    batch = Batch()
    batch.run(plan)
    begun = process_time()
    batch.run(plan)
    return process_time() - begun
