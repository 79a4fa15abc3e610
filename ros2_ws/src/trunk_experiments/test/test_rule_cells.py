"""One cell of a rule table, by its name, wherever a parameter can be given; what changed, cell by cell."""

import math
import re

import pytest

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.rule_tables import KD_AS_PRINTED, Axes
from trunk_core.errors import StudyError, TrunkError
from trunk_core.parameters.declarations import ParameterError, values_of
from trunk_core.parameters.parameter_files import ParameterFileError
from trunk_evidence.parameter_text import change_grid, change_text, differing_texts
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments import api as trunk
from trunk_runs.live_parameters import with_tables
from trunk_runs.plan import make_plan
from trunk_studies.rows import make_bases, plan_of
from trunk_studies.study import design, parse_study

CELL, OTHER = "rules.kd.ZO.ZO", "rules.kd.NB.PB"
CHANGED = ("S S S S S S 0.5", *KD_AS_PRINTED[1:3], "B B B S B B B", *KD_AS_PRINTED[4:])
STUDY = """
scenario: demo
runs: 1
duration: 0.5
controllers: [fuzzy_pid, pid]
set: {fuzzy_pid.rules.kd.NB.PB: 0.5}
vary:
  middle: {parameter: fuzzy_pid.rules.kd.ZO.ZO, values: [S, B]}
"""


def from_settings(folder):
    settings = [f"fuzzy_pid.{CELL}=S", f"fuzzy_pid.{OTHER}=0.5"]
    return make_plan("demo", "fuzzy_pid", settings=settings).controller.rules_kd


def from_file(text):
    def table(folder):
        path = folder / "cells.yaml"
        path.write_text(f"fuzzy_pid:\n  ros__parameters:\n    {text}\n")
        return make_plan("demo", "fuzzy_pid", [str(path)]).controller.rules_kd

    return table


def from_library(folder):
    overrides = {f"fuzzy_pid.{CELL}": "S", f"fuzzy_pid.{OTHER}": 0.5}
    return trunk.plan("demo", "fuzzy_pid", overrides=overrides).parameters["fuzzy_pid"]["rules.kd"]


def from_branch(folder):
    run = trunk.simulate(trunk.plan("demo", "fuzzy_pid", duration=0.1), output=folder / "a.mcap")
    overrides = {f"fuzzy_pid.{CELL}": "S", f"fuzzy_pid.{OTHER}": 0.5}
    branch = trunk.branch(run, 0.05, overrides=overrides, output=folder / "b.mcap")
    assert trunk.verify(branch).verified
    (change,) = RecordedRun.open(folder / "b.mcap").parameter_changes("fuzzy_pid")
    return change.changed["rules.kd"]


def from_sweep(folder):
    study = parse_study(STUDY, "study.yaml")
    bases = make_bases(study)
    columns = design(study, 0, 4)
    plans = [plan_of(study, bases, {n: c[i] for n, c in columns.items()}) for i in range(4)]
    tables = [plan.controller.rules_kd for plan in plans[::2]]
    assert tables[1] == ("S S S S S S 0.5", *KD_AS_PRINTED[1:])
    return tables[0]


def from_a_running_node(folder):
    present = {
        n: list(v) if isinstance(v, tuple) else v for n, v in values_of(FuzzyPidConfig()).items()
    }
    given = {CELL: "S", OTHER: 0.5}
    changed = with_tables(
        "/robot/fuzzy_pid",
        FuzzyPidConfig,
        "params set",
        given,
        lambda names: {n: present[n] for n in names},
    )
    assert list(changed) == ["rules.kd"]
    return tuple(changed["rules.kd"])


@pytest.mark.parametrize(
    "place",
    [
        pytest.param(from_settings, id="--set"),
        pytest.param(from_file("rules: {kd: {ZO: {ZO: S}, NB: {PB: 0.5}}}"), id="nested"),
        pytest.param(from_file(f"{{{CELL}: S, {OTHER}: 0.5}}"), id="dotted"),
        pytest.param(from_library, id="library"),
        pytest.param(from_branch, id="branch", marks=pytest.mark.slow),
        pytest.param(from_sweep, id="sweep"),
        pytest.param(from_a_running_node, id="running"),
    ],
)
def test_a_cell_means_the_same_everywhere(place, tmp_path):
    assert place(tmp_path) == CHANGED


def test_a_later_table_takes_the_place_of_an_earlier_cell(tmp_path):
    path = tmp_path / "cells.yaml"
    path.write_text(f"fuzzy_pid:\n  ros__parameters: {{{CELL}: S}}\n")
    plan = make_plan("demo", "fuzzy_pid", [str(path), "fuzzy_as_printed"])
    assert plan.controller.rules_kd == KD_AS_PRINTED


@pytest.mark.parametrize(
    ("setting", "error", "line"),
    [
        (
            "rules.kd.ZO.ZO=X",
            ParameterFileError,
            "labels S, B, or numbers from 0 to 1; cell (e ZO, e_dot ZO)",
        ),
        ("rules.kd.ZO.ZO=2.0", ParameterFileError, "or numbers from 0 to 1"),
        ("rules.kd.ZO.ZO=[S]", ParameterFileError, "a label, or a number"),
        ("rules.kd.ZO=S", ParameterFileError, "has a column too: rules.kd.ZO.COLUMN"),
        ("reference.values.ZO.ZO=S", ParameterFileError, "no such parameter"),
    ],
)
def test_a_cell_that_is_not_there_gives_one_line(setting, error, line):
    with pytest.raises(error, match=re.escape(line)) as caught:
        make_plan("demo", "fuzzy_pid", settings=[f"fuzzy_pid.{setting}"])
    assert str(caught.value).startswith(f"--set fuzzy_pid.{setting}: fuzzy_pid: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", ["X", "2.0"])
def test_a_grid_over_a_cell_is_checked_before_the_first_run(value):
    study = parse_study(STUDY.replace("[S, B]", f"[S, {value!r}]"), "study.yaml")
    with pytest.raises((StudyError, ParameterError), match=r"labels S, B, or numbers from 0 to 1"):
        make_bases(study)


def test_what_changed_is_told_cell_by_cell():
    axes = Axes()
    assert change_text(KD_AS_PRINTED, CHANGED, axes) == "2 cells: (NB, PB) S → 0.5, (ZO, ZO) B → S"
    assert change_text(KD_AS_PRINTED, ("S B", "B S"), axes) == "2 × 2 cells, not 7 × 7 cells"
    grid = change_grid(KD_AS_PRINTED, CHANGED, axes)
    assert grid[0] == ["e \\ e_dot", *axes.rate]
    assert (grid[1][7], grid[4][4], grid[1][1]) == ("S→0.5", "B→S", "S")
    texts = differing_texts((KD_AS_PRINTED, CHANGED, KD_AS_PRINTED), axes)
    assert texts == ("7 × 7 cells", "2 cells: (NB, PB) S → 0.5, (ZO, ZO) B → S", "the same")


def test_of_a_large_table_only_what_changed_is_drawn():
    before = (" ".join(["S"] * 64),) * 64
    after = (*before[:9], before[9].replace("S", "B", 1), *before[10:])
    axes = Axes(tuple(f"E{i}" for i in range(1, 65)), tuple(f"R{i}" for i in range(1, 65)))
    assert change_grid(before, after, axes) == [["e \\ e_dot", "R1"], ["E10", "S→B"]]


def test_values_that_differ_look_different():
    assert differing_texts((0.1, 0.2)) == ("0.1", "0.2")
    assert differing_texts((0.1, 0.1 + 2**-50)) == ("0.1", repr(0.1 + 2**-50))


def test_an_element_of_an_array_is_set_by_its_index():
    plan = make_plan("demo", "pid", settings=["simulator.initial.position[1]=20deg"])
    assert plan.simulator.initial_state.theta == pytest.approx(math.radians(20.0), rel=1e-15)
    both = ["simulator.initial.position=[0.5, 0.1]", "simulator.initial.position[0]=10cm"]
    assert make_plan("demo", "pid", settings=both).simulator.initial_position == (0.1, 0.1)
    for setting, says in (
        ("simulator.initial.position[2]=1", r"has the elements \[0\] to \[1\]"),
        ("simulator.initial.position[-1]=1", r"has the elements \[0\] to \[1\]"),
        ("simulator.initial.position[1]=1m", "an angle in rad is needed"),
        ("simulator.plant.trunk_mass[0]=1", "did you mean 'plant.trunk_mass'"),
    ):
        with pytest.raises(TrunkError, match=says):
            make_plan("demo", "pid", settings=[setting])
