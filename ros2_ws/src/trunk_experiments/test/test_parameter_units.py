"""Units of every declared parameter, in plans, on the command line and in a running node's file."""

import math
import subprocess
import sys

import pytest
import yaml
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.errors import PlanError, TrunkError
from trunk_core.parameters.declarations import ParameterError, declarations, values_of
from trunk_core.parameters.parameter_files import ParameterFileError, read
from trunk_core.parameters.quantity import SYMBOLS, Unit, parse_unit
from trunk_core.parameters.to_si import to_si, units_of
from trunk_experiments.cli import trunk
from trunk_runs.live_parameters import choosers_of, class_of, said_in_si
from trunk_runs.nodes import NODES
from trunk_runs.plan import make_plan, parse_swap
from trunk_runs.scenario import parse_setting, shipped_files

NUMERIC = [
    (node, declaration)
    for node, kind in NODES.items()
    for declaration in declarations(kind.config).values()
    if declaration.kind.startswith(("double", "integer"))
]
IDS = [f"{node} {declaration.name}" for node, declaration in NUMERIC]
# One of each dimension that is declared, and one that is not.
OTHERS = ("kg", "m", "s", "rad", "N", "N m", "Hz", "rad/s", "m/s", "N m/rad", "kg^2", "%")


def values_for(declaration, number, unit, place):
    """Return the value of a parameter with one number written in a unit."""
    written = f"{number!r} {unit}"
    if not declaration.kind.endswith("array"):
        return written
    return [*[0.0] * place, written]


def test_there_are_such_parameters():
    assert len(NUMERIC) > 100
    assert any(declaration.unit_by for _, declaration in NUMERIC)


@pytest.mark.parametrize(("node", "declaration"), NUMERIC, ids=IDS)
def test_every_declared_unit_is_read_and_is_si(node, declaration):
    if declaration.kind.startswith("integer"):
        assert not declaration.unit  # counts: whole numbers are never converted
    for units in units_of(declaration):
        for unit in units:
            found = parse_unit(unit or "1")
            assert found == Unit(dimension=found.dimension)


@given(st.sampled_from(NUMERIC), st.floats(allow_nan=False, allow_infinity=False), st.data())
def test_a_number_in_its_declared_unit_is_the_number(which, number, data):
    node, declaration = which
    if declaration.kind.startswith("integer"):
        return
    declared = declarations(NODES[node].config)
    elements = units_of(declaration)
    place = data.draw(st.integers(0, len(elements) - 1))
    unit = data.draw(st.sampled_from(elements[place]))
    given_values = {declaration.name: values_for(declaration, number, unit or "1", place)}
    if declaration.unit_by:
        choose = {unit: value for value, unit in declaration.units}
        given_values[declaration.unit_by] = choose[unit]
    found = to_si(declared, given_values)[declaration.name]
    read_number = found[place] if isinstance(found, list) else found
    assert repr(read_number) == repr(number)


@given(st.sampled_from(NUMERIC), st.sampled_from(OTHERS), st.data())
def test_a_unit_of_another_dimension_is_refused(which, other, data):
    node, declaration = which
    if declaration.kind.startswith("integer"):
        return
    declared = declarations(NODES[node].config)
    chosen = declared[declaration.unit_by].default if declaration.unit_by else None
    elements = units_of(declaration, {declaration.unit_by: chosen})
    place = data.draw(st.integers(0, len(elements) - 1))
    (unit,) = elements[place]
    if parse_unit(other).dimension == parse_unit(unit or "1").dimension:
        return
    with pytest.raises(ParameterError) as caught:
        to_si(declared, {declaration.name: values_for(declaration, 5.0, other, place)})
    assert f"'5.0 {other}' is not allowed" in str(caught.value)
    assert (unit or "a plain number") in str(caught.value)
    assert "is needed" in str(caught.value)


def test_files_settings_and_options_take_units(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "simulator:\n  ros__parameters:\n"
        "    initial: {position: [10 cm, 45 deg], velocity: [1, 9 deg/s]}\n"
        "    sensor: {delay: 100ms, position_noise: 0.5 mrad}\n"
        "    max_effort: inf N m\n"
        "disturbance:\n  ros__parameters:\n"
        "    pulse: {start_times: [1 s, 1500 ms, 2], duration: 50ms, magnitude: 100 deg}\n"
    )
    settings = ["pid.gains.p=9.6N*m/rad", "pid.gains.d=2 N m s/deg", "simulator.substeps=4"]
    plan = make_plan("fig8", "pid", [str(file)], settings)
    simulator = values_of(plan.simulator)
    assert simulator["initial.position"] == (0.1, math.radians(45.0))
    assert simulator["initial.velocity"] == (1.0, math.radians(9.0))
    assert simulator["sensor.delay"] == 0.1
    assert simulator["sensor.position_noise"] == 0.0005
    assert simulator["max_effort"] == math.inf
    assert type(simulator["substeps"]) is int
    disturbance = values_of(plan.disturbance)
    assert disturbance["pulse.start_times"] == (1.0, 1.5, 2.0)
    assert disturbance["pulse.magnitude"] == math.radians(100.0)
    assert values_of(plan.controller)["gains.p"] == 9.6
    assert values_of(plan.controller)["gains.d"] == 360.0 / math.pi

    written = tmp_path / "params.yaml"
    plan.write_parameters(written)
    assert all(
        not isinstance(value, str) for value in yaml.safe_load(written.read_text())
        ["/simulator"]["ros__parameters"]["initial.position"]
    )  # fmt: skip
    plain = make_plan("fig8", "pid", [str(written)])
    assert plain.simulator == plan.simulator
    assert plain.disturbance == plan.disturbance


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from(["", " "]),
    st.sampled_from([*SYMBOLS, "1/s^2", "/s^2", "N m/(rad s)", "N*m/rad", "N m s/rad"]),
)
def test_yaml_leaves_a_number_with_a_unit_as_text(number, space, unit):
    text = f"{number!r}{space}{unit}"
    (section,) = parse_setting(f"simulator.sensor.delay=[{text}]").sections
    assert section.values == {"sensor.delay": [text]}
    (section,) = parse_setting(f"simulator.sensor.delay={text}").sections
    assert section.values == {"sensor.delay": text}


def test_a_mistake_in_a_file_names_file_node_parameter_value_and_unit(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("simulator: {ros__parameters: {sensor.delay: 5 kg}}")
    with pytest.raises(ParameterFileError) as caught:
        make_plan("fig6", "pid", [str(file)])
    assert str(caught.value) == (
        f"{file}: simulator: parameter 'sensor.delay': '5 kg' is not allowed: "
        "it is a mass; a time in s is needed, such as 5 s or 5 ms"
    )


def test_a_value_out_of_bounds_is_shown_in_si_and_as_written():
    with pytest.raises(ParameterFileError, match=r"3600\.0 is not allowed: .* \(written 1 h\)$"):
        make_plan("fig6", "pid", settings=["simulator.sensor.delay=1 h"])
    with pytest.raises(ParameterFileError, match=r"11\.0 is not allowed: [^(]*$"):
        make_plan("fig6", "pid", settings=["simulator.sensor.delay=11.0"])


def test_only_plain_angles_of_more_than_a_turn_are_doubted():
    doubted = make_plan("fig7", "pid", settings=["pid.reference.value=400"]).warnings
    assert any("angles are in radians" in warning for warning in doubted)
    meant = make_plan("fig7", "pid", settings=["pid.reference.value=400 deg"]).warnings
    assert not any("angles are in radians" in warning for warning in meant)


def test_texts_are_never_numbers():
    plan = make_plan("fig6", "pid", settings=["recorder.output=5 m"])
    assert plan.recorder.output == "5 m"


def test_swaps_take_units():
    assert parse_swap("1500ms:pid") == (1.5, "pid")
    with pytest.raises(PlanError, match=r"T is '4 kg': it is a mass; a time in s is needed"):
        parse_swap("4 kg:pid")


@pytest.mark.slow
def test_options_of_verbs_take_units(tmp_path):
    file = tmp_path / "run.mcap"

    def ran(*words):
        return CliRunner().invoke(trunk, [str(word) for word in words])

    done = ran(
        "simulate", "fig6", "--controller", "pid", "--rate", "0.5 kHz", "--duration", "100ms",
        "--set", "simulator.initial.position=[0, 10 deg]", "-o", file,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "51 states" in done.output
    assert "update_s" in ran("explain", file, "--at", "50ms", "--json").output
    table = tmp_path / "part.csv"
    assert ran("export", file, "--from", "20 ms", "--to", "40ms", "-o", table).exit_code == 0
    assert len(table.read_text().splitlines()) == 12
    assert ran("tune", "lqr", "--angle", "0.1 rad", "--torque", "5 N*m").exit_code == 0
    assert ran("tune", "lqr", "--rate", "200").output == ran("tune", "lqr", "--rate=0.2kHz").output
    wrong = ran("simulate", "fig6", "--duration", "5 kg", "-o", tmp_path / "no.mcap")
    assert wrong.exit_code == 2
    assert "Invalid value for '--duration': '5 kg': it is a mass; a time in s" in wrong.output


def in_si(node, said, present):
    return said_in_si(node, class_of(node, (), dict), "mine.yaml", said, present)


def test_a_file_for_a_running_node_takes_units():
    said = {"gains.p": "50 N m/rad", "joint": "5 m"}
    assert in_si("/pid", said, {}) == {
        "gains.p": 50.0,
        "joint": "5 m",
    }
    assert in_si("/another/name", said, {}) == said
    with pytest.raises(TrunkError, match=r"^mine\.yaml: /pid: parameter 'gains\.p': '50 N m' is"):
        in_si("/pid", {"gains.p": "50 N m"}, {})


def test_what_a_running_node_has_chooses_the_unit():
    said = {"pulse.magnitude": "50 N", "sine.frequency": "1 Hz"}
    assert choosers_of(class_of("/left/disturbance", (), dict), said) == ["pulse.channel"]
    present = {"pulse.channel": "hip_effort"}
    assert in_si("/disturbance", said, present)["pulse.magnitude"] == 50.0
    with pytest.raises(TrunkError, match="it is a force; an angle in rad is needed"):
        said_in_si(
            "/disturbance",
            class_of("/disturbance", (), dict),
            "mine.yaml",
            said,
            {"pulse.channel": "trunk_position"},
        )
    both = {**said, "pulse.channel": "hip_effort"}
    assert said_in_si(
        "/disturbance",
        class_of("/disturbance", (), dict),
        "mine.yaml",
        both,
        {"pulse.channel": "trunk_position"},
    )


def test_shipped_files_are_plain_for_nodes():
    """They are given to nodes by --params-file as well, and ROS 2 knows no units."""
    for path in shipped_files().values():
        for section in read(path).sections:
            for node in (section.last_token,) if section.last_token in NODES else NODES:
                declared = declarations(NODES[node].config)
                values = {k: v for k, v in section.values.items() if k in declared}
                assert to_si(declared, values) == values


def test_units_are_loaded_only_where_one_is_used():
    code = (
        "import sys\n"
        "from trunk_experiments.cli import trunk\n"
        "from trunk_runs.plan import make_plan\n"
        "trunk(['--help'], standalone_mode=False)\n"
        "trunk(['plan', '--help'], standalone_mode=False)\n"
        "make_plan('fig8', 'pid', settings=['pid.gains.p=50'])\n"
        "assert 'trunk_core.parameters.quantity' not in sys.modules\n"
        "make_plan('fig8', 'pid', settings=['pid.gains.p=50 N m/rad'])\n"
        "assert 'trunk_core.parameters.quantity' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
