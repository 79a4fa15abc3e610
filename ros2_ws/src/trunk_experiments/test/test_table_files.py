"""CSV files in place of numbers: in parameter files, settings, studies, the library and running nodes."""

import math
from pathlib import Path

import pytest
import yaml

import trunk_experiments.api as trunk
from trunk_core.parameters.declarations import (
    ParameterError,
    build,
    declarations,
    listed,
    values_of,
)
from trunk_core.parameters.parameter_files import Layer, ParameterFileError, Section
from trunk_runs.live_parameters import class_of, planned_names, with_numbers
from trunk_runs.nodes import NODES
from trunk_runs.plan import make_plan
from trunk_sim.disturbance_config import DisturbanceConfig
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.rows import make_bases, plan_of
from trunk_studies.study import design, read_study

REFERENCE = "t [ms],reference [deg]\n0,0\n250,20\n250,10\n400,-5\n"
PUSH = "t [s],value [N*m]\n0.1,0\n0.2,4\n0.3,0\n"
DEGREES = (0.0, math.radians(20), math.radians(10), math.radians(-5))
PLANNED = "reference: {profile: interpolated, file: ref.csv}"
OF_REFERENCE = ["pid.reference.profile=interpolated", "pid.reference.file=mine/ref.csv"]
OF_PUSH = ["disturbance.table.file=mine/push.csv"]
RANDOM = [
    "disturbance.pulse.start_times=[0.45]",
    "disturbance.pulse.duration=0.02",
    "disturbance.pulse.random_count=3",
    "disturbance.pulse.random_until=0.4",
]
SHORT = {"duration": 0.5, "update_rate": 400.0}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Work in a folder whose sub-folder has the files, with parameters that name them."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "ref.csv").write_text(REFERENCE)
    (folder / "push.csv").write_text(PUSH)
    (folder / "mine.yaml").write_text(
        f"pid:\n  ros__parameters:\n    {PLANNED}\n"
        "disturbance:\n  ros__parameters:\n    table: {file: push.csv, channel: trunk_effort}\n"
    )
    return tmp_path


def planned(settings=(), params=(), scenario="demo"):
    return make_plan(scenario, "pid", params, settings, SHORT)


def test_a_path_is_relative_to_its_file_or_to_the_working_directory():
    from_file = planned(params=["mine/mine.yaml"])
    from_settings = planned([*OF_REFERENCE, *OF_PUSH])
    for plan in (from_file, from_settings):
        values = values_of(plan.controller)
        assert values["reference.profile"] == "interpolated"
        assert values["reference.times"] == (0.0, 0.25, 0.25, 0.4)
        assert values["reference.values"] == DEGREES
        assert values_of(plan.disturbance)["table.values"] == (0.0, 4.0, 0.0)
    assert from_file.configs == from_settings.configs


def test_hold_makes_a_sequence():
    plan = planned([*OF_REFERENCE, "pid.reference.profile=sequence"])
    values = values_of(plan.controller)
    assert (values["reference.profile"], values["reference.values"]) == ("sequence", DEGREES)


def test_a_plan_has_numbers_that_nodes_accept(here):
    plan = planned(params=["mine/mine.yaml"])
    plan.write_parameters(here / "params.yaml")
    text = (here / "params.yaml").read_text()
    assert "csv" not in text
    for node, config in plan.configs.items():
        section = yaml.safe_load(text)[f"/{node}"]["ros__parameters"]
        assert build(type(config), section) == config
    assert planned(params=["params.yaml"]).configs == plan.configs


@pytest.mark.parametrize(
    ("node", "values", "name"),
    [
        ("pid", {"reference.file": "ref.csv"}, "reference.file"),
        ("disturbance", {"table.file": "push.csv"}, "table.file"),
    ],
)
def test_nodes_have_no_file_parameters(node, values, name):
    config = NODES[node].config
    with pytest.raises(ParameterError) as caught:
        build(config, values)
    assert caught.value.name == name
    assert name in listed(config)


def test_what_can_be_written_is_listed(command_says):
    _, out, _ = command_says("params", "pid")
    assert "pid.reference.file" in out
    for node in ("pid", "disturbance"):
        code, out, _ = command_says("params", node, "--markdown")
        assert code == 0
        assert all(f"| `{name}`" in out for name in planned_names(class_of(f"/{node}", (), dict)))
    code, out, err = command_says("params", "show", "mine/mine.yaml")
    assert (code, err) == (0, "")
    assert "CSV with the columns t and reference" in out


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (["pid.reference.profile=step"], "step"),
        (["pid.reference.profile=constant", *OF_REFERENCE], "interpolated"),
        (["pid.reference.file=''", "pid.reference.profile=sine"], "sine"),
    ],
)
def test_what_comes_later_wins(last, expected):
    plan = planned(last, ["mine/mine.yaml"])
    assert plan.controller.reference_profile == expected
    earlier = ["pid.reference.times=[1.0]", "pid.reference.values=[2.0]"]
    assert planned([*earlier, *OF_REFERENCE]).controller.reference_values == DEGREES


WITH = "it is used only with reference.profile: interpolated or sequence"
WRONG = {
    "pid.reference.file=mine/ref.csv": (
        f"pid: parameter 'reference.file': 'mine/ref.csv' is not allowed: {WITH}"
    ),
    "pid.reference.profile=interpolated": (
        "pid: parameter 'reference.profile': 'interpolated' is not allowed: "
        "at least one of reference.times is needed"
    ),
    "disturbance.table.file=5": (
        "disturbance: parameter 'table.file': 5 is not allowed: a string is needed, the path of a CSV file"
    ),
    "disturbance.table.file=none.csv": (
        "disturbance: table.file: none.csv: no such file: give a CSV file's path"
    ),
    "disturbance.table.file=mine": "disturbance: table.file: mine: no such file: give a CSV file's path",
}  # fmt: skip
BESIDES = {
    "pid.reference.times=[1.0]": (
        "pid: parameter 'reference.times': [1.0] is not allowed: "
        "reference.file gives the numbers: give only one of the two"
    ),
    "disturbance.table.values=[1.0]": (
        "disturbance: parameter 'table.values': [1.0] is not allowed: "
        "table.file gives the numbers: give only one of the two"
    ),
}  # fmt: skip


@pytest.mark.parametrize("setting", [*WRONG, *BESIDES])
def test_a_mistake_gives_one_line_that_names_its_place(setting):
    before = [*OF_REFERENCE, *OF_PUSH] if setting in BESIDES else []
    with pytest.raises(ParameterFileError) as caught:
        planned([*before, setting])
    assert str(caught.value) == f"--set {setting}: {(WRONG | BESIDES)[setting]}"


def test_a_file_besides_another_profile_in_the_same_place_is_a_mistake(here):
    (here / "two.yaml").write_text(
        "pid:\n  ros__parameters: {reference: {file: mine/ref.csv, profile: constant}}\n"
    )
    with pytest.raises(ParameterFileError, match=WITH):
        planned(params=["two.yaml"])


def test_a_mistake_in_a_csv_names_both_files_and_the_line(here):
    (here / "mine/ref.csv").write_text(REFERENCE + "0.1,0\n")
    with pytest.raises(ParameterFileError) as caught:
        planned(params=["mine/mine.yaml"])
    assert str(caught.value) == (
        "mine/mine.yaml: pid: reference.file: mine/ref.csv: line 6: t: '0.1' is not allowed: "
        "times must ascend, and this one is before the time in the row above"
    )


def test_the_channel_chooses_the_unit(here):
    with pytest.raises(ParameterFileError, match=r"'N\*m' is not allowed: it is a torque; a force"):
        planned([*OF_PUSH, "disturbance.table.channel=hip_effort"])
    (here / "mine/push.csv").write_text("t,value [deg]\n0,90\n")
    plan = planned([*OF_PUSH, "disturbance.table.channel=trunk_position"])
    assert plan.disturbance.table_values == (math.pi / 2.0,)


def test_only_plain_angles_of_more_than_a_turn_are_doubted(here):
    for heading, doubted in (("reference", True), ("reference [deg]", False)):
        (here / "mine/ref.csv").write_text(f"t,{heading}\n0,400\n")
        warnings = planned(OF_REFERENCE).warnings
        assert any("angles are in radians" in one for one in warnings) == doubted


@pytest.mark.parametrize(("how", "profile"), [("linear", "interpolated"), ("hold", "sequence")])
def test_tables_are_interpolated_or_held(how, profile):
    settings = [*OF_REFERENCE, *OF_PUSH, *RANDOM, f"disturbance.table.interpolation={how}"]
    plan = planned([*settings, f"pid.reference.profile={profile}"])
    table = run_compiled(plan).table
    found = len({*table.reference.tolist()})
    assert found > 100 if how == "linear" else found == 3


def test_simulate_verify_metrics_and_like(command_says):
    settings = [word for one in (*OF_REFERENCE, *OF_PUSH, *RANDOM) for word in ("--set", one)]
    options = ("demo", "--controller", "pid", "--duration", "0.5", *settings)
    assert command_says("simulate", *options, "-o", "run.mcap")[0] == 0
    for name in ("ref.csv", "push.csv"):
        Path("mine", name).unlink()  # the recording is complete in itself
    code, out, err = command_says("verify", "run.mcap")
    assert code == 0, out + err
    assert out.startswith("run.mcap: verified\n")
    assert command_says("metrics", "run.mcap")[0] == 0
    assert command_says("simulate", "--like", "run.mcap", "-o", "again.mcap")[0] == 0
    assert "identical" in command_says("diff", "run.mcap", "again.mcap")[1]
    code, _, err = command_says("simulate", *options, "-o", "third.mcap")
    assert (code, err.count("\n")) == (2, 1)
    assert "mine/ref.csv: no such file" in err


STUDY = """
scenario: demo
controllers: [pid]
rate: 200
duration: 0.4
runs: 2
set:
  pid.reference.profile: interpolated
  disturbance.table.file: push.csv
  disturbance.pulse.random_count: 2
vary:
  reference: {parameter: pid.reference.file, values: [ref.csv, other.csv]}
"""


def test_a_study_varies_files_beside_it_and_draws_the_pulses(here):
    (here / "mine/other.csv").write_text("t,reference\n0,0.25\n")
    (here / "mine/study.yaml").write_text(STUDY)
    study = read_study("mine/study.yaml")
    bases = make_bases(study)
    table = design(study, 0, study.total)
    rows = [dict(zip(table, cells, strict=True)) for cells in zip(*table.values(), strict=True)]
    plans = [plan_of(study, bases, row) for row in rows]
    assert [plan.controller.reference_values for plan in plans] == [DEGREES] * 2 + [(0.25,)] * 2
    assert {plan.disturbance.table_values for plan in plans} == {(0.0, 4.0, 0.0)}
    starts = [plan.disturbance.signals.pulse_starts for plan in plans]
    assert starts[:2] == starts[2:]  # the same two draws
    assert starts[0] != starts[1]


def test_the_library_takes_paths(here):
    overrides = {"pid.reference.profile": "sequence", "pid.reference.file": here / "mine/ref.csv"}
    plan = trunk.plan("demo", "pid", overrides=overrides)
    assert plan.parameters["pid"]["reference.values"] == DEGREES
    names = set(trunk.parameters("disturbance"))
    assert names == {*declarations(NODES["disturbance"].config), "table.file"}
    with pytest.raises(trunk.TrunkError, match=r"no such file: give a CSV file's path$"):
        trunk.plan("demo", "pid", overrides={**overrides, "pid.reference.file": "none.csv"})


def test_a_running_node_gets_the_numbers():
    asked = []

    def values(names):
        asked.append(names)
        return dict.fromkeys(names, "hip_position")

    Path("mine/push.csv").write_text("t,value [cm]\n0.1,0\n0.2,400\n0.3,0\n")
    said = {"table.file": "mine/push.csv", "sine.amplitude": 1.0}
    layer = Layer("params set", (Section("/left/disturbance", said),))
    assert with_numbers("/left/disturbance", DisturbanceConfig, layer, said, values) == {
        "sine.amplitude": 1.0,
        "table.times": [0.1, 0.2, 0.3],
        "table.values": [0.0, 4.0, 0.0],
    }
    assert asked == [["table.channel"]]
    unknown = Layer("params set", (Section("/other", said),))
    assert with_numbers("/other", None, unknown, said, values) == said
