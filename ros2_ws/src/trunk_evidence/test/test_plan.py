import math

import pytest

from trunk_control.rule_tables import KD_AS_PRINTED, KP_AS_PRINTED
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import ParameterError
from trunk_core.parameters.parameter_files import ParameterFileError, read, resolve
from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_runs.scenario import SCENARIOS, shipped_files
from trunk_sim.disturbances import disturbance_at


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("controller", ["pid", "fuzzy_pid"])
def test_every_scenario_makes_a_plan(scenario, controller):
    plan = make_plan(scenario, controller)
    assert plan.simulator.duration == 10.0
    assert plan.simulator.update_rate == plan.controller.update_rate
    assert (plan.disturbance is not None) == (scenario in ("fig8", "fig9", "demo", "cart_pole"))


@pytest.mark.parametrize("name", sorted(shipped_files()))
def test_every_shipped_file_is_readable_and_described(name):
    path = shipped_files()[name]
    assert path.read_text().startswith("# ")
    scenario, params = (name, []) if name in SCENARIOS else ("fig6", [name])
    make_plan(scenario, "pid", params)
    assert make_plan(scenario, "fuzzy_pid", params).scenario == scenario


def test_a_push_comes_on_top_of_the_scenarios_disturbances():
    plan = make_plan("demo", "pid", pushes=["60Nm:0.1s@3"])
    before = make_plan("demo", "pid").disturbance.signals
    for ms, torque in ((2_999, 0.0), (3_000, 60.0), (3_099, 60.0), (3_100, 0.0)):
        acting = disturbance_at(ms * 1_000_000, plan.disturbance.signals)
        assert acting.trunk_torque == torque
        assert acting._replace(trunk_torque=0.0) == disturbance_at(ms * 1_000_000, before)
    assert make_plan("fig6", "pid", pushes=["hip_effort=1N:1s"]).disturbance is not None
    assert make_plan("fig6", "pid", pushes=[]).disturbance is None


@pytest.mark.parametrize(
    ("push", "message"),
    [("60", "VALUE:DURATION"), ("60Nm:0.1s@11", "ends at 10 s"), ("1:1s@-1s", "from 0 s on")],
)
def test_a_push_that_cannot_act_is_refused(push, message):
    with pytest.raises(PlanError, match=message):
        make_plan("demo", "pid", pushes=[push])


def test_the_paper_profile_is_the_default_of_the_figures():
    controller = make_plan("fig7", "pid").controller
    assert (controller.derivative_mode, controller.u_clamp_max) == ("error", math.inf)
    assert controller.antiwindup_strategy == "none"
    assert make_plan("fig7", "pid").simulator.substeps == 10


def test_a_later_profile_wins_and_keeps_the_rate():
    plan = make_plan("fig7", "pid", ["profile_practical"])
    assert (plan.controller.derivative_mode, plan.controller.u_clamp_max) == ("rate", 100.0)
    assert plan.controller.antiwindup_strategy == "conditional_integration"
    assert plan.controller.update_rate == 1000.0


def test_both_gain_sets_are_shipped_and_never_mixed():
    zn = make_plan("fig6", "pid", ["pid_as_printed", "pid_ziegler_nichols"]).controller
    printed = make_plan("fig6", "pid", ["pid_ziegler_nichols", "pid_as_printed"]).controller
    assert (zn.p, zn.i, zn.d) == (60.0, 100.0, 9.0)
    assert (printed.p, printed.i, printed.d) == (60.0, 36.0, 400.0)


def test_the_shipped_rule_tables():
    printed = make_plan("fig6", "fuzzy_pid", ["fuzzy_zhao_1993", "fuzzy_as_printed"]).controller
    zhao = make_plan("fig6", "fuzzy_pid", ["fuzzy_zhao_1993"]).controller
    assert (printed.rules_kp, printed.rules_kd) == (KP_AS_PRINTED, KD_AS_PRINTED)

    def changed(a, b):
        return {(i, j) for i in range(7) for j in range(7) if a[i].split()[j] != b[i].split()[j]}

    assert changed(printed.rules_kp, zhao.rules_kp) == {(1, 1), (1, 5), (5, 1), (5, 5)}
    assert changed(printed.rules_kd, zhao.rules_kd) == {(1, 6)}
    assert printed.rules_alpha == zhao.rules_alpha
    assert make_plan("fig6", "fuzzy_pid", ["fuzzy_log"]).controller.consequents == "log"


def test_the_command_line_wins_over_files():
    plan = make_plan(
        "fig8",
        "fuzzy_pid",
        ["profile_practical"],
        ["fuzzy_pid.u_clamp_max=50", "simulator.plant.length=1e0", "disturbance.pulse.magnitude=2"],
        {"duration": 3.0, "update_rate": 500.0},
    )
    assert plan.controller.u_clamp_max == 50.0
    assert (plan.simulator.length, plan.simulator.duration) == (1.0, 3.0)
    assert plan.disturbance.pulse_magnitude == 2.0
    rates = {plan.simulator.update_rate, plan.controller.update_rate, plan.disturbance.update_rate}
    assert rates == {500.0}


def test_a_plan_written_as_a_file_is_the_same_plan(tmp_path):
    plan = make_plan("fig8", "fuzzy_pid", settings=["simulator.sensor.delay=0.1"])
    path = tmp_path / "params.yaml"
    plan.write_parameters(path)
    again = make_plan(str(path), "fuzzy_pid")
    assert again.simulator == plan.simulator
    assert again.controller == plan.controller
    assert again.disturbance == plan.disturbance
    assert resolve("/simulator", [read(path)], ["sensor.delay"]) == {"sensor.delay": 0.1}


BAD = {
    "no scenario": (("fig5", "pid"), {}, PlanError, "fig6"),
    "no controller": (("fig6", "lqg"), {}, PlanError, "fuzzy_pid"),
    "no file": (("fig6", "pid", ["mine"]), {}, PlanError, "pid_as_printed"),
    "no node": (("fig6", "pid", [], ["plant.length=1"]), {}, PlanError, "simulator"),
    "no value": (("fig6", "pid", [], ["simulator.plant.length"]), {}, PlanError, "VALUE"),
    "a faster controller": (
        ("fig6", "pid", [], ["pid.update_rate=2000"]),
        {},
        PlanError,
        "above the simulator's",
    ),
    "an incommensurate one": (
        ("fig6", "pid", [], ["pid.update_rate=300"]),
        {},
        PlanError,
        "not an integer divisor",
    ),
    "another joint": (
        ("fig6", "pid", [], ["pid.joint=knee"]),
        {},
        PlanError,
        "pid: joint 'knee' is not the second of the simulator's joints: hip, trunk",
    ),
    "another joint of the reference": (
        ("fig7", "pid", [], ["reference.joint=knee"]),
        {"external": ""},
        PlanError,
        "reference: joint 'knee' is not the second of the simulator's joints",
    ),
    "other joints of the simulator": (
        ("demo", "pid", [], ["simulator.joints=[hip, torso]", "pid.joint=torso"]),
        {},
        PlanError,
        "disturbance: joints hip, trunk are not the simulator's joints: hip, torso",
    ),
    "a text that ROS 2 reads as false": (
        ("fig6", "pid", [], ["pid.joint=N"]),
        {},
        ParameterFileError,
        "--set pid.joint=N: pid: parameter 'joint': False is not allowed: string; a text that reads as",
    ),
    "digits with an underscore": (
        ("fig6", "pid", [], ["simulator.plant.length=1_0"]),
        {},
        ParameterFileError,
        "'1_0' is not allowed: there is no unit '_0'",
    ),
    "an index in digits of another script": (
        ("fig6", "pid", [], ["simulator.initial.position[\u0661]=0.1"]),
        {},
        ParameterFileError,
        "initial.position has the elements [0] to [1]",
    ),
    "more than the largest number": (
        ("fig6", "pid", [], ["simulator.max_effort=1e400"]),
        {},
        ParameterFileError,
        "'1e400' is not allowed: double",
    ),
    "a negative duration": (
        ("fig6", "pid"),
        {"everywhere": {"duration": -1.0}, "source": "--"},
        ParameterFileError,
        "--duration: simulator: ",
    ),
    "a negative rate": (
        ("fig6", "pid"),
        {"everywhere": {"duration": 1.0, "update_rate": -1.0}},
        ParameterFileError,
        "rate: simulator: ",
    ),
}


@pytest.mark.parametrize(("arguments", "more", "kind", "says"), BAD.values(), ids=BAD.keys())
def test_impossible_requests_are_refused_in_one_line(arguments, more, kind, says):
    with pytest.raises(kind) as caught:
        make_plan(*arguments, **more)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, PlanError | ParameterFileError | ParameterError)


@pytest.mark.parametrize(
    ("rate", "says"),
    [(1000.0, "is at least half the bound 800"), (500.0, "is at the bound 400"), (2000.0, None)],
)
def test_a_derivative_gain_near_the_sampled_bound_gives_a_warning(rate, says):
    plan = make_plan("fig6", "pid", ["pid_as_printed"], everywhere={"update_rate": rate})
    assert len(plan.warnings) == (says is not None)
    assert says is None or says in plan.warnings[0]


def test_a_controller_slower_than_the_plant_is_allowed():
    plan = make_plan("fig6", "pid", settings=["pid.update_rate=250"])
    assert plan.controller.period_ns == 4 * plan.simulator.period_ns


@pytest.mark.parametrize(
    "value", ["[1", "? [a]", "&a [*a]", "[" * 5000, "!!int 1_0", "!!int ''"], ids=repr
)
def test_a_value_that_is_not_yaml_gives_one_short_line(value):
    with pytest.raises(
        PlanError, match=r"^--set .simulator\.seed=.*cannot be read: line 1: "
    ) as caught:
        make_plan("fig6", "pid", settings=[f"simulator.seed={value}"])
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("text", ["inf", ".inf", "+Infinity"])
def test_infinity_may_be_written_without_a_dot(text):
    assert (
        make_plan("fig6", "pid", settings=[f"simulator.max_effort={text}"]).simulator.max_effort
        == math.inf
    )


def test_the_same_joints_in_another_order_are_the_same():
    plan = make_plan("demo", "pid", settings=["disturbance.joints=[trunk, hip]"])
    assert plan == make_plan("demo", "pid")


def test_a_disturbance_that_does_nothing_may_name_other_joints():
    settings = ["simulator.joints=[hip, torso]", "pid.joint=torso"]
    assert make_plan("fig6", "pid", settings=settings).disturbance is None


def test_a_disturbance_is_published_one_plant_step_ahead(tmp_path):
    plan = make_plan("demo", "pid", settings=["simulator.update_rate=1000", "simulator.duration=1"])
    assert plan.disturbance.update_rate == 1000.0
    record_offline(plan, tmp_path / "run.mcap")
    assert verify(Recording.open(tmp_path / "run.mcap")).exit_code == VERIFIED
