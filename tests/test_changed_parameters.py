"""What was changed while a run went on is shown by every verb that shows a run."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from trunk_core.parameters.declarations import values_of
from trunk_evidence.differences import diff
from trunk_evidence.parameter_text import changed_parameters, lines_of, transition_text, value_text
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments import api
from trunk_runs.engine import states_of_run
from trunk_runs.offline_recording import record_states
from trunk_runs.plan import RunPlan, make_plan
from trunk_runs.timeline import Change

Trunk = Callable[..., tuple[int, str, str]]
RULES = "rules.kp"
MS = 1_000_000


def plan() -> RunPlan:
    return make_plan("demo", "fuzzy_pid", everywhere={"duration": 0.3})


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run as planned, and one in which a gain, a rule and a limit were changed."""
    folder = tmp_path_factory.mktemp("runs")
    rows = list(values_of(plan().configs["fuzzy_pid"])[RULES])
    rows[0] = "S" + rows[0][1:]
    changed = {
        "fuzzy_pid": [
            Change(-1, {"gains.p_max": 70.0}),
            Change(100 * MS, {"gains.p_max": 90.0, RULES: tuple(rows)}),
        ],
        "simulator": [Change(50 * MS, {"max_effort": 20.0})],
    }
    paths = folder / "plain.mcap", folder / "changed.mcap"
    for path, made in zip(paths, (plan(), replace(plan(), changes=changed)), strict=True):
        record_states(made, states_of_run(made, compiled=False), path, ("fuzzy_pid",))
    return paths


LINES = [
    "t = 0 s: fuzzy_pid: gains.p_max 60 → 70",
    "t = 0.05 s: simulator: max_effort inf → 20",
    "t = 0.1 s: fuzzy_pid: gains.p_max 70 → 90",
    "t = 0.1 s: fuzzy_pid: rules.kp 1 cell: (NB, NB) B → S",
]


def test_each_change_is_listed_with_its_time_node_and_values(recorded: tuple[Path, Path]) -> None:
    plain, changed = map(RecordedRun.open, recorded)
    assert changed_parameters(plain) == []
    assert lines_of(changed_parameters(changed)) == LINES
    many = changed_parameters(changed) * 10
    assert lines_of(many)[20:] == ["and 20 more: trunk info RUN --json"]


def test_a_difference_between_runs_names_what_was_changed_in_one(
    recorded: tuple[Path, Path],
) -> None:
    plain, changed = map(RecordedRun.open, recorded)
    assert diff(plain, changed).parameters == [f"{line}, in B alone" for line in LINES]
    assert diff(changed, plain).parameters == [f"{line}, in A alone" for line in LINES]
    assert diff(changed, changed).parameters == []


@pytest.mark.parametrize("after", [(1.0, 2.0), ("B",), (), 1, None])
def test_a_table_that_becomes_something_else_is_shown_as_it_is(after: object) -> None:
    """In a file that no node of ours wrote."""
    assert transition_text(("B B", "S S"), after, {"fuzzy.error_labels": 3}) == (
        f"2 × 2 cells → {value_text(after)}"
    )


@pytest.mark.parametrize(
    ("words", "prefix"),
    [
        (["info"], ""),
        (["compare"], "changed: "),
        (["compare", "--markdown"], "- changed: "),
    ],
    ids=["info", "compare", "markdown"],
)
def test_verbs_list_it(
    trunk: Trunk, recorded: tuple[Path, Path], words: list[str], prefix: str
) -> None:
    runs = recorded[1:] if words == ["info"] else recorded
    said = trunk(*words, *runs)[1].splitlines()
    first = said.index(prefix + LINES[0])
    assert said[first : first + 4] == [prefix + line for line in LINES]


def test_documents_pages_and_the_library_have_it(
    trunk: Trunk, recorded: tuple[Path, Path], tmp_path: Path
) -> None:
    changes = json.loads(trunk("info", recorded[1], "--json")[1])["changed"]
    assert [(c["t"], c["name"], c["before"], c["after"]) for c in changes[:2]] == [
        (0.0, "gains.p_max", 60.0, 70.0),
        (0.05, "max_effort", "Infinity", 20.0),
    ]
    by_run = json.loads(trunk("compare", *recorded, "--json")[1])["changed"]
    assert by_run == {"plain": [], "changed": changes}
    run = api.load(recorded[1])
    assert [change.words for change in run.changed] == [change["words"] for change in changes]
    page = tmp_path / "page.html"
    trunk("report", recorded[1], "-o", page)
    assert all(line in page.read_text("utf-8") for line in LINES)
