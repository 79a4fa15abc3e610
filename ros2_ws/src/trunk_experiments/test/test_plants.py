"""Plants as plug-ins: every engine and every reader takes one, and what is the trunk's alone is refused."""

import json
import pickle
import re
import shutil
import subprocess
import sys
from dataclasses import make_dataclass, replace
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.text import Text

from trunk_control.laws import law_named, law_of
from trunk_core.errors import PlanError, StudyError, TrunkError
from trunk_core.parameters.declarations import declarations, parameter, values_of
from trunk_core.parameters.shared import PLANT_NAME
from trunk_core.topics import MARKER_ARRAY_TYPE
from trunk_evidence.judgement import verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.verdict import VERIFIED
from trunk_experiments.conformance.kit import first_difference
from trunk_msgs_util.picture.frames import as_data, resolved
from trunk_recording.reader import Recording
from trunk_recording.schemas import deserialize
from trunk_runs.nodes import CONTROLLERS, NODES, config_class, parameters_of
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_sim.config import TrunkSimulator
from trunk_sim.plant import PLANTS, Coordinate, PlantConfig
from trunk_sim.plants.trunk import PLANT
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.batch.kernel import kernel_of, start_of_run, words_of
from trunk_studies.study import parse_study
from trunk_studies.tuning.floquet import prepared
from trunk_views.plots import overview
from trunk_views.report_data import report_data
from trunk_views.run_report import make_report
from trunk_views.run_view import RunView, of_either_drive

from ...trunk_recording.test.mcap_files import ANEW, content, write_file
from ...trunk_studies.test.cpp_device import COMPILER, CppDevice, summary_in
from ...trunk_studies.test.test_kernel import bits
from .test_own_packages import python

CART_POLE = ("simulator.plant.name=cart_pole", "simulator.initial.position=[0.1, 10deg]")
GAINS = ("pid.gains.p=60", "pid.gains.i=3", "pid.gains.d=12")
DRIVE = (
    "simulator.actuator.time_constant=0.02",
    "simulator.actuator.coulomb_friction=0.2",
    "simulator.actuator.viscous_friction=0.1",
    "simulator.actuator.dead_band=0.05",
    "simulator.max_effort=30",
    "simulator.plant.friction=0.4",
)
SENSORS = (
    "simulator.sensor.position_noise=0.002",
    "simulator.sensor.delay=10ms",
    "simulator.sensor.position_resolution=0.001",
)
PUSHED = (
    "disturbance.pulse.channel=cart_effort",
    "disturbance.pulse.start_times=[0.4]",
    "disturbance.pulse.magnitude=8N",
    "disturbance.sine.channel=pole_effort",
    "disturbance.sine.amplitude=0.05",
    "disturbance.noise.channel=cart_position",
    "disturbance.noise.rms=0.01",
)
ANY_PLANT = [name for name in CONTROLLERS if name != "computed_torque"]


ARM, POLE = Coordinate("arm", "rad"), Coordinate("pole", "rad")


def planned(controller="pid", *settings, **options):
    everywhere = {"duration": 1.5, "update_rate": 200.0}
    gains = GAINS if controller == "pid" else ()
    given = [*CART_POLE, *gains, *settings]
    return make_plan("fig6", controller, settings=given, everywhere=everywhere, **options)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("cart") / "cart.mcap"
    record_offline(planned("pid", *PUSHED, *DRIVE), path)
    return path


def test_the_picture_is_the_plants(tmp_path, recorded):
    path = tmp_path / "drawn.mcap"
    record_offline(planned("pid", "recorder.markers=true"), path)
    ((_, drawn),) = [*Recording.open(path).messages("/markers")][:1]
    names = [marker.ns for marker in deserialize(MARKER_ARRAY_TYPE, drawn[0]).markers]
    assert {"cart", "pole", "mass", "disturbance/cart", "disturbance/pole"} <= {*names}
    world = report_data([RunView.read(RecordedRun.open(recorded))])["runs"][0]["world"]
    assert world["picture"] == as_data(
        resolved(PLANTS.named("cart_pole").picture, {"plant.length": 0.5})
    )
    assert world["drive"] == 0


@pytest.mark.parametrize(
    ("controller", "settings"),
    [
        *zip(
            ANY_PLANT,
            cycle([DRIVE, (*SENSORS, *PUSHED), ("simulator.substeps=3",), ()]),
            strict=False,
        )
    ],
)
def test_all_engines_give_the_same_bits(controller, settings):
    assert first_difference(planned(controller, *settings)) is None


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
def test_a_kernels_text_gives_them_too(tmp_path):
    plan = planned("pid", *DRIVE, *PUSHED)
    start = start_of_run(plan)
    kernel = kernel_of(plan, start)
    outcomes = CppDevice(tmp_path).run(kernel, words_of(kernel, [(start, 1)]))
    from trunk_studies.batch.block import summary_of

    assert bits(summary_in(outcomes, 0)) == bits(summary_of(plan))


def test_a_recording_verifies_and_names_its_plant(recorded):
    verdict = verdict_on(RecordedRun.open(recorded))
    assert verdict.exit_code == VERIFIED, verdict
    run = RecordedRun.open(recorded)
    assert run.parameters["simulator"][PLANT_NAME] == "cart_pole"
    for node in ("simulator", "disturbance"):
        assert run.parameters[node]["joints"] == ("cart", "pole")
    assert run.plan().simulator.kind is PLANTS.named("cart_pole")


def test_a_controller_moves_the_cart_and_not_the_pole():
    table = run_compiled(planned("pid", "simulator.initial.position=[0, 0]", *PUSHED[:3])).table
    pushed = table.x_dot[table.t > 0.6]
    assert pushed.min() > 0.1
    assert np.abs(table.theta).max() > 0.0


def test_the_trunks_classes_are_as_they_were():
    assert NODES["simulator"].config is TrunkSimulator
    assert PLANT_NAME not in declarations(TrunkSimulator)
    assert PLANT_NAME not in declarations(config_class("disturbance"))
    assert config_class("simulator", {PLANT_NAME: "trunk"}) is TrunkSimulator


def test_another_plants_parameters_have_its_names_units_and_words():
    of_plant, of_trunk = parameters_of("simulator", "cart_pole"), parameters_of("simulator")
    assert of_plant[PLANT_NAME].fixed
    assert [name for name in of_plant if name not in of_trunk] == [
        *("plant.cart_mass", "plant.mass", "plant.friction", PLANT_NAME)
    ]
    assert of_plant["max_effort"].unit == "N"
    assert of_plant["actuator.viscous_friction"].unit == "N s/m"
    assert of_plant["initial.velocity"].unit == "m/s, rad/s"
    assert "zero force" in of_plant["command_timeout"].description
    for node in ("simulator", "disturbance", "reference", *ANY_PLANT):
        for name, declared in parameters_of(node, "cart_pole").items():
            assert "N m" not in declared.unit or name == "operator.torque" or "," in declared.unit
            known = name.removeprefix("hip_")  # a law's parameter keeps its name
            words = f"{known} {declared.description} {declared.allowed}".replace("_", " ").split()
            assert not {"hip", "trunk", "hip's", "trunk's"} & set(words), name


def test_a_laws_parameters_have_the_plants_joints_and_units():
    law, trunks = (parameters_of("state_feedback", plant) for plant in ("cart_pole", "trunk"))
    assert law.keys() == trunks.keys()
    assert (law["joint"].default, law["hip_joint"].default) == ("pole", "cart")
    names = ("u_clamp_max", *(f"gains.{name}" for name in "pidxv"))
    units = [law[name].unit for name in names]
    assert units == ["N", "N/rad", "N/(rad s)", "N s/rad", "N/m", "N s/m"]
    arm = replace(PLANTS.named("cart_pole"), coordinates=(ARM, POLE), drive=0)
    trunks_of = declarations(config_class("state_feedback"))
    on_an_arm = [arm.redeclared(declared, law=True).unit for declared in map(trunks_of.get, names)]
    assert on_an_arm == ["N m", "N m/rad", "N m/(rad s)", "N m s/rad", "N m/rad", "N m s/rad"]
    scale = declarations(config_class("fuzzy", {PLANT_NAME: "cart_pole"}))["fuzzy.output_scale"]
    assert (scale.unit, scale.units) == ("N or N/s", (("pd", "N"), ("pi", "N/s")))


def test_a_first_coordinate_that_turns_has_torques_and_angles():
    arm = replace(PLANTS.named("cart_pole"), coordinates=(ARM, POLE), drive=0)
    for node in ("simulator", "disturbance"):
        config = config_class(
            node, {PLANT_NAME: "cart_pole"}
        )  # all plants' parameters, and its own
        for declared in map(arm.redeclared, declarations(config.of_trunk).values()):
            told = f"{declared.unit}, {declared.description}"
            assert not re.search(r"\b(N|m|force|x)\b", told.replace("N m", "")), told


def test_a_laws_numbers_are_read_in_the_plants_units(recorded, tmp_path, command_says):
    assert planned("pid", "pid.u_clamp_max=0.5kN").controller.u_clamp_max == 500.0
    with pytest.raises(TrunkError, match="it is a torque; a force in N is needed"):
        planned("pid", "pid.u_clamp_max=5 N m")
    with pytest.raises(TrunkError, match="it is a force; a torque in N m is needed"):
        make_plan("fig6", "pid", settings=["pid.u_clamp_max=5 N"])
    words = "branch", recorded, "--at", "1", "-o", tmp_path / "branch.mcap"
    assert command_says(*words, "--set", "pid.u_clamp_max=5N")[0] == 0


def test_its_laws_are_those_of_the_trunk():
    for name in ANY_PLANT:
        config = planned(name).controller
        assert law_of(config) is law_named(name)
        assert values_of(config).keys() == values_of(law_named(name).config()).keys()


def test_its_configuration_crosses_processes():
    disturbed = planned("pid", *PUSHED)
    for config in (planned().simulator, disturbed.disturbance, disturbed.controller):
        again = pickle.loads(pickle.dumps(config))
        assert again == config
        assert type(again) is type(config)
        assert values_of(again) == values_of(config)


@pytest.mark.parametrize(
    ("settings", "controller", "words"),
    [
        (("simulator.plant.name=cartpole",), "pid", "an installed plant (trunk, cart_pole"),
        (("simulator.plant.length=0",), "pid", "parameter plant.length"),
        (("simulator.path.amplitude=1",), "pid", "path.amplitude"),
        (("disturbance.pulse.channel=hip_effort",), "pid", "cart_effort"),
        (
            (),
            "computed_torque",
            "it contains a model of the plant trunk, and this one is cart_pole",
        ),
    ],
)
def test_what_is_not_this_plants_is_refused_in_one_line(settings, controller, words):
    with pytest.raises(TrunkError) as refusal:
        planned(controller, *settings)
    assert words in str(refusal.value).replace("'", "")
    assert "\n" not in str(refusal.value)


def test_multipliers_are_the_trunks():
    with pytest.raises(PlanError, match=r"plant\.name: cart_pole: multipliers are those of the"):
        prepared(planned())


def test_a_push_without_a_channel_is_the_drives():
    pushes = ["8N:0.1s@0.5"]
    assert planned("pid", pushes=pushes).disturbance.table_channel == "cart_effort"
    with pytest.raises(PlanError, match="cart_effort=300N:50ms"):
        planned("pid", pushes=["trunk_effort=3N:1s"])


CART, POLE = PLANTS.named("cart_pole").coordinates


def with_mass(name="plant.mass", default=1.0):
    mass = parameter(name, default, "The mass", unit="kg", minimum=0.5)
    return make_dataclass("Config", [("mass", float, mass)], bases=(PlantConfig,), frozen=True)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"coordinates": (CART, POLE, Coordinate("tail", "rad"))}, "3 coordinates: two"),
        ({"coordinates": (POLE, CART)}, "coordinates in 'rad' and 'm'"),
        ({"coordinates": (CART, POLE._replace(joint="cart"))}, "'cart' and 'cart': two names"),
        ({"coordinates": (CART, POLE._replace(joint="the rod"))}, "names of letters, digits"),
        ({"drive": 2}, "drive 2: 0 or 1"),
        ({"fall": 90.0}, "fall 90.0: an angle in rad"),
        ({"label": ""}, "label '': a text"),
        ({"start": (0.0, 0.1, 0.0, 0.0)}, "a PlantState is needed"),
        ({"picture": None}, "picture None: a Picture"),
        ({"config": dict}, "a subclass of PlantConfig"),
        ({"config": with_mass("mass")}, "parameter 'mass': a name such as plant.mass"),
        ({"config": with_mass(PLANT_NAME)}, "and not plant.name"),
        ({"config": with_mass(default=0.1)}, "a default: parameter 'plant.mass': 0.1 is not"),
    ],
)
def test_what_is_no_plant_is_refused_when_it_is_made(changed, words):
    with pytest.raises(TypeError, match=r"^plant 'cart_pole': ") as refusal:
        replace(PLANTS.named("cart_pole"), **changed)
    assert words in str(refusal.value)


WITHOUT = """
import sys
from importlib import metadata
registered = metadata.entry_points
module = sys.argv.pop(1)
def entry_points(**wanted):
    for entry in registered(**wanted):
        if entry.name != "cart_pole":
            yield entry
        elif module:
            yield metadata.EntryPoint(entry.name, f"{module}:PLANT", entry.group)
metadata.entry_points = entry_points
from trunk_experiments.cli import main
main()
"""
UNUSABLE = {
    "": "install the package that has it",
    "no_such": "cannot be loaded: ModuleNotFoundError",
    "trunk_sim.plants.trunk": "calls itself 'trunk'",
}


@pytest.mark.parametrize(("module", "told"), UNUSABLE.items(), ids=["missing", "broken", "other"])
@pytest.mark.parametrize(
    ("verb", "code"),
    [
        ("verify", 2),
        ("metrics", 0),
        ("info", 0),
        ("explain --at 1", 2),
        ("plot -o a.png", 0),
        ("report -o a.html", 0),
        ("compare run.mcap", 0),
        ("export -o a.gif", 2),
    ],
)
def test_a_run_whose_plant_cannot_be_used_is_a_line(tmp_path, recorded, verb, code, module, told):
    (tmp_path / "run.mcap").symlink_to(recorded)
    name, *options = verb.split()
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, module, name, str(recorded), *options],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    if code:
        assert told in done.stdout + done.stderr


def test_branches_and_repetitions_are_of_the_same_plant(recorded, tmp_path, command_says):
    branch, again = tmp_path / "branch.mcap", tmp_path / "again.mcap"
    settings = ["--set", "simulator.plant.mass=0.2kg", "--push", "4N:0.1s@1.2"]
    assert command_says("branch", recorded, "--at", "1", *settings, "-o", branch)[0] == 0
    assert command_says("simulate", "--like", recorded, "-o", again)[0] == 0
    codes = {verdict_on(RecordedRun.open(path)).exit_code for path in (branch, again)}
    assert codes == {VERIFIED}


def test_a_study_knows_its_units(tmp_path, command_says):
    study = tmp_path / "study.yaml"
    study.write_text(
        json.dumps(
            {
                "scenario": "fig6",
                "controllers": ["pid", "lqr"],
                "duration": 0.5,
                "rate": 200,
                "set": {"simulator.plant.name": "cart_pole"},
                "vary": {
                    "mass": {"parameter": "simulator.plant.mass", "values": ["50 g", "0.2 kg"]}
                },
            }
        )
    )
    results = tmp_path / "results.parquet"
    assert command_says("sweep", study, "-o", results)[0] == 0
    shown = tmp_path / "shown.mcap"
    code, out, _ = command_says("study", "show", results, "--run", "1", "-o", shown)
    assert code == 0
    assert "bit for bit" in out
    assert RecordedRun.open(shown).parameters["simulator"]["plant.mass"] in (0.05, 0.2)


def test_the_report_offers_the_laws_that_its_plant_takes(recorded):
    (section,) = make_report([RunView.read(RecordedRun.open(recorded))]).runs
    assert list(section.controllers) == ANY_PLANT


def test_pages_and_pictures_speak_of_its_joints_and_of_a_force(recorded, reported):
    view = RunView.read(RecordedRun.open(recorded))
    page = reported([view])
    seen = page.evaluate("() => document.body.innerText")
    assert "the pole did not fall" in seen
    assert {"cart x", "peak force (N)", "Force τ, N"} <= {*re.split("[\n\t]", seen)}
    texts = [text.get_text() for text in overview([view]).findobj(Text)]
    assert {"Pole angle", "Force on the cart"} <= {*texts}
    for text in (*seen.split("\n"), *texts):
        assert (
            not re.search(r"\b(hip|trunks?|torque)\b|N·m", text, re.IGNORECASE) or "trunk " in text
        )


def test_peaks_off_the_scale_have_the_plants_unit_and_limits_that_show_an_entry(
    recorded, monkeypatch
):
    view = RunView.read(RecordedRun.open(recorded))
    assert "force limits" in [text.get_text() for text in overview([view]).findobj(Text)]
    monkeypatch.setattr("trunk_views.plots.off_scale", lambda values: 1.0)
    texts = [text.get_text() for text in overview([view]).findobj(Text)]
    assert any(re.fullmatch(r"off scale: short peaks up to [\d,]+ N", text) for text in texts)
    assert "force limits" not in texts


def test_of_several_plants_each_has_its_words_and_all_an_effort(recorded, short_run, reported):
    runs = (short_run("fig8", "pid"), recorded)
    views = [RunView.read(RecordedRun.open(run)) for run in runs]
    page = reported(views)
    seen = page.evaluate("() => document.body.innerText")
    assert {"torque", "hip x", "force", "cart x"} <= {*re.split("[\n\t]", seen)}
    said = ("Effort τ, N or N·m", "peak effort (N or N·m)", "hip path · Cart-pole", "pole did not")
    assert [text for text in said if text not in seen] == []
    units = [text.split()[-1] for text in page.locator("[data-value=torque]").all_inner_texts()]
    assert units == ["N·m", "N"]
    texts = [text.get_text() for text in overview(views).findobj(Text)]
    assert {"effort limits", "Path, travelled range in colour", "$y$ (m)"} <= {*texts}


@pytest.mark.parametrize(
    ("plants", "either"),
    [
        ([PLANTS.named("cart_pole")], False),
        ([None], True),
        ([PLANT, PLANTS.named("cart_pole")], True),
        ([PLANT, None], True),
        ([PLANT, replace(PLANT, name="another")], False),  # each makes a torque
    ],
)
def test_an_effort_is_a_force_or_a_torque(plants, either):
    assert of_either_drive([SimpleNamespace(plant=plant) for plant in plants]) is either


def test_what_users_name_keeps_its_name(recorded, reported, tmp_path):
    path = tmp_path / "trunk torque.mcap"
    shutil.copy(recorded, path)
    views = [RunView.read(RecordedRun.open(run)) for run in (path, recorded)]
    seen = reported(views).evaluate("() => document.body.innerText")
    assert "trunk torque" in seen
    assert "pole force" not in seen
    (legend,) = overview(views).legends
    assert "trunk torque" in [text.get_text() for text in legend.get_texts()]
    assert PLANTS.named("cart_pole").of_drive("torque_ff") == "torque_ff"


def test_pictures_of_several_plants_name_no_joint(recorded, short_run):
    views = [RunView.read(RecordedRun.open(run)) for run in (recorded, short_run("fig8", "pid"))]
    titles = [axes.get_title("left") for axes in overview(views).axes]
    assert titles[:2] == ["Angle", "Effort"]


def test_a_run_keeps_its_plant(recorded, tmp_path, command_says):
    change = ("--set", "simulator.plant.name=trunk")
    code, _, err = command_says("branch", recorded, "--at", "1", *change, "-o", tmp_path / "b.mcap")
    assert code == 2
    assert "simulator.plant.name: it is fixed when a run starts" in err
    study = """
scenario: cart_pole
controllers: [pid]
vary: {plant: {parameter: simulator.plant.name, values: [trunk, cart_pole]}}
"""
    with pytest.raises(StudyError, match="a study has one plant"):
        parse_study(study, "study.yaml")


FAULTY = """
from dataclasses import make_dataclass, replace
from trunk_sim.plants.cart_pole import PLANT as CART_POLE

def accelerations(state, force, torque, constants):
    return force / constants.weight, state.theta

PLANT = replace(CART_POLE, name="faulty", accelerations=accelerations)
"""


@pytest.mark.parametrize("words", ["simulate fig6 -o x.mcap", "margins --controller pid"])
def test_a_plants_own_fault_is_a_line_that_names_its_place(tmp_path, words):
    info = tmp_path / "faulty-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text("[trunk.plants]\nfaulty = faulty:PLANT\n")
    (tmp_path / "faulty.py").write_text(FAULTY)
    setting = ("--set", "simulator.plant.name=faulty", "--set", "simulator.substeps=1")
    done = python(
        tmp_path, "from trunk_experiments.cli import main; main()", *words.split(), *setting
    )
    assert done.returncode not in (0, 70), done.stderr
    assert "Traceback" not in done.stderr
    assert "plant 'faulty': " in done.stderr
    assert "in accelerations: AttributeError" in done.stderr
    assert "trunk plant check faulty tests it alone" in done.stderr


def test_a_law_that_leaves_the_cart_alone_is_named():
    said = "does not hold the cart, which may go anywhere"
    assert f"pid {said}" in planned("pid").warnings
    assert not any(said in line for line in planned("state_feedback").warnings)
    assert not make_plan("fig6", "pid").warnings


def test_a_joint_that_is_not_there_is_an_obstacle(recorded, tmp_path):
    plan = planned("state_feedback")
    path, forged = tmp_path / "run.mcap", tmp_path / "forged.mcap"
    record_offline(plan, path)
    edited = content(path)
    for message in edited.messages:
        if b"hip_joint" in message[2]:
            message[2] = message[2].replace(b"cart\0", b"nope\0")
    write_file(edited, forged, ANEW)
    verdict = verdict_on(RecordedRun.open(forged))
    assert "hip_joint 'nope' is not one of" in " ".join(verdict.obstacles)
