"""Every verb's ``--json``: one document on stdout that fits its schema, whatever the verb finds."""

from dataclasses import fields, replace
from math import inf

import pytest

from trunk_evidence.run_metrics import Metrics
from trunk_experiments.lab.webassembly import missing_tools
from trunk_studies.paper import reproduction
from trunk_studies.paper.claims import PaperRun, cases
from trunk_studies.paper.errata import ERRATA

from .documents import SCHEMAS, checked, documents_of
from .documents import VERBS as DOCUMENTED
from .verbs import VERBS

# tests/graph/test_json.py
ELSEWHERE = {"run-1", "params-apply-1", "page-1", "explain-external-1"}


class Case:
    """A command, the document that it writes, its exit code, and the command to run first."""

    def __init__(self, name, words, code=0, before=""):
        self.name, self.words, self.code, self.before = name, words.split(), code, before.split()
        skipped = missing_tools() if self.words[0] == "lab" else ""
        self.param = pytest.param(
            self, id=words, marks=pytest.mark.skipif(bool(skipped), reason=skipped)
        )


def document_of(words):
    """Return the document that the command writes that these words begin with."""
    second = words[:2] in (("info", "--check"), ("sweep", "--sobol"))
    return next(
        documents_of(DOCUMENTED[words[:count]])[0][second]
        for count in (2, 1)
        if words[:count] in DOCUMENTED
    )


CASES = [
    *(
        Case(name, " ".join(verb.sound), code=int(verb.name == "diff"))  # of two runs
        for verb in VERBS
        if (name := document_of(verb.words)) not in ELSEWHERE
    ),
    Case("simulate-1", "simulate --like a.mcap -o again.mcap"),
    Case("simulate-1", "simulate fig6 --controller pid --set pid.gains.d=1e6 -o new.mcap", 1),
    Case("branch-1", "branch a.mcap --at 0.1 --push 9Nm:0.1s -o new.mcap"),
    Case("branch-1", "branch a.mcap --at 0.1 --set simulator.max_effort=9 --at 0.2 -o new"),
    Case("plan-1", "plan fig8 --lockstep -o new.yaml"),
    Case("metrics-1", "metrics cut.mcap"),
    Case("report-1", "report a.mcap b.mcap"),
    Case("compare-1", "compare a.mcap b.mcap cut.mcap"),
    Case("explain-1", "explain b.mcap --at 1.06"),
    Case("plot-1", "plot a.mcap b.mcap -o x.svg"),
    Case("diff-1", "diff a.mcap a.mcap"),
    Case("diff-1", "diff a.mcap cut.mcap", 1),
    Case("diff-study-1", "diff swept.parquet swept.parquet"),
    Case(
        "diff-study-1",
        "diff swept.parquet other.parquet",
        1,
        before="sweep drawn.yaml -o other.parquet --jobs 1",
    ),
    Case("verify-2", "verify cut.mcap", 2),
    Case("info-1", "info cut.mcap"),
    Case("list-runs-1", "list runs --verify"),
    Case("list-plants-1", "list plants"),
    Case("list-files-1", "list files"),
    Case("list-files-1", "list studies"),
    Case("list-schemas-1", "list schemas"),
    Case("info-check-1", "info --check cut.mcap", 1),
    Case("recover-1", "recover cut.mcap -o new.mcap", 1),
    Case("export-1", "export a.mcap -o a.csv -o a.parquet -o a.npz -o c.mcap"),
    Case("export-c-1", "export-c pid --name hip --like a.mcap -o c"),
    Case("export-c-1", "export-c fuzzy_pid --name left_hip -o c"),
    Case("params-1", "params"),
    Case("params-show-1", "params show fig8"),
    Case("new-1", "controller new mine"),
    Case("check-1", "controller check pid"),
    Case("new-plant-1", "plant new mine"),
    Case("check-plant-1", "plant check cart_pole"),
    Case("sweep-1", "sweep study.yaml -o new.parquet --check"),
    Case("map-1", "study map swept.parquet"),
    Case("tune-1", "tune poles -o gains.yaml"),
    Case("tune-1", "tune relay --lag 0.01 --damping 1"),
    Case("tune-1", "tune optimise --controller fuzzy_pid --generations 1 --population 2"),
    Case("limit-1", "limit fig6 --vary simulator.sensor.delay --to 0.5 --within 0.1"),
    Case("margins-1", "margins"),
    Case("margins-1", "margins b.mcap -o loop.png"),
]


@pytest.fixture
def short(monkeypatch):
    """Make the paper as short as possible: it has its own tests."""
    monkeypatch.setattr(reproduction, "_figure", lambda figure, folder: "data:image/png;base64,AA")
    monkeypatch.setattr(reproduction, "reproduce", lambda folder, graph, say: reproduced())


def reproduced():
    """Return results of the paper's runs: one diverged, and the graph's have the same bits."""
    values = Metrics(**{f.name: 1.0 for f in fields(Metrics)})
    runs = {case: PaperRun(case, values, 2.0) for case in cases()}
    first = next(iter(runs))
    runs[first] = PaperRun(first, None, inf, "diverged")
    graph = {case: replace(run, graph_differs="") for case, run in runs.items()}
    return reproduction.Reproduction(
        runs=runs,
        graph=graph,
        errata=[(ERRATA[0], True, "a < b")],
        rates={"fig7": {1000.0: dict.fromkeys(reproduction.RATE_KEYS, 1.0), 250.0: None}},
        literal={"none, derived": None, "pid, derived": values},
    )


@pytest.mark.slow
@pytest.mark.parametrize("case", [case.param for case in CASES])
def test_one_document_that_fits_its_schema(case, recordings_here, command_says, short):
    if case.before:
        assert command_says(*case.before)[0] == 0
    code, out, err = command_says(*case.words, "--json")
    checked(out, case.name)
    assert code == case.code, err
    assert "Traceback" not in err


def test_every_document_has_a_schema_and_every_schema_a_verb():
    named = {
        name for verb in DOCUMENTED.values() for (names,) in [documents_of(verb)] for name in names
    }
    assert named | {"error-1"} == set(SCHEMAS)
    assert named == {case.name for case in CASES} | ELSEWHERE
