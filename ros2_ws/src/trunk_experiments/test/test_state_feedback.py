"""A cart-pole linearised, its LQR, its sampled loop: by the book, python-control, exponentials and runs."""

import re
from dataclasses import replace
from math import inf, pi, radians

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.linalg import expm

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_control.controller import Controller
from trunk_control.fuzzy_torque import FuzzyConfig
from trunk_control.law import Hip
from trunk_control.lqr import LqrConfig
from trunk_control.pid import PidConfig
from trunk_control.state_feedback import StateFeedbackConfig
from trunk_core.errors import PlanError, TuningError
from trunk_experiments.cli import trunk
from trunk_runs.plan import make_plan
from trunk_sim.config import TrunkSimulator, simulator_class
from trunk_sim.plant import PLANTS, Coordinate, PlantState, advance
from trunk_sim.plants.cart_pole import PLANT, CartPole, accelerations
from trunk_sim.plants.trunk import passive, prescribed
from trunk_studies.tuning.floquet import prepared
from trunk_studies.tuning.linear import LinearLoop, linearise, linearised, loop_of
from trunk_studies.tuning.methods import by_state, controllable, sampled
from trunk_studies.tuning.search import own_space
from trunk_studies.tuning.stability_margins import margins

REST = PlantState(0.0, 0.0, 0.0, 0.0)
ON_A_CART = ["simulator.plant.name=cart_pole"]
CartSimulator = simulator_class({"plant.name": "cart_pole"})


def of_cart(constants: CartPole, friction: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return linearised(accelerations, constants, REST, 0, friction)


def of_trunk(moves=passive, friction: float = 0.0, **masses) -> tuple[np.ndarray, np.ndarray]:
    simulator = TrunkSimulator(**masses)
    return linearised(moves, simulator.kind.level(simulator.constants), REST, 1, friction)


H = 0.001
SIMULATOR = CartSimulator(update_rate=1.0 / H)
USUAL = SIMULATOR.constants
LARGEST = 0.3, radians(6.0), 1.0, 1.0  # m, rad, m/s, rad/s
EFFORT = 10.0  # N
A, B = of_cart(USUAL)
GAINS = by_state(A, B, LARGEST, EFFORT)


def feedback(gains) -> StateFeedbackConfig:
    """Return the law with the gains K of u = -K (x, theta, x', theta')."""
    x, p, v, d = gains
    return StateFeedbackConfig(update_rate=1.0 / H, hip_joint="cart", x=x, p=p, v=v, d=d, i=0.0)


def loop(config, **given) -> LinearLoop:
    return loop_of(replace(SIMULATOR, **given), config)


def in_the_book(c: CartPole) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B of (x, th, x', th') about the upright."""
    a, across = np.zeros((4, 4)), c.cart_mass * c.length
    a[0, 2] = a[1, 3] = 1.0
    a[2, 1:3] = c.mass * c.gravity / c.cart_mass, -c.friction / c.cart_mass
    a[3, 1:3] = (c.cart_mass + c.mass) * c.gravity / across, -c.friction / across
    return a, np.array([0.0, 0.0, 1.0 / c.cart_mass, 1.0 / across])


def held_over(a, b, h=H):
    """Return A and B over a period, the input held."""
    joined = expm(np.block([[a, b[:, None]], [np.zeros((1, 5))]]) * h)
    return joined[:4, :4], joined[:4, 4]


@pytest.mark.parametrize(
    "plant", [USUAL, CartPole(1.5, 0.4, 0.8, 9.0, 0.7), CartPole(0.1, 3.0, 2.0, 1.6, 20.0)]
)
def test_the_linear_cart_pole_is_the_books(plant):
    a, b = of_cart(plant)
    in_book = in_the_book(plant)
    assert a == pytest.approx(in_book[0], rel=1e-6, abs=1e-9)
    assert b == pytest.approx(in_book[1], rel=1e-9)


def test_the_usual_cart_pole_has_the_known_numbers():
    assert A[2:, 1] == pytest.approx([0.4905, 20.601], rel=1e-6)
    assert B.tolist() == pytest.approx([0.0, 0.0, 0.5, 1.0])
    assert np.sort(np.linalg.eigvals(A).real) == pytest.approx(
        [-4.5388, 0.0, 0.0, 4.5388], abs=5e-5
    )


def test_a_command_on_the_angle_and_friction_are_told_apart():
    turned, by_torque = linearised(accelerations, USUAL, REST, 1, friction=0.02)
    assert by_torque[2:] == pytest.approx([1.0, 42.0])  # 1 / (M l), (M + m) / (M m l^2)
    assert turned[2:, 3] == pytest.approx([-0.02, -0.84])
    pushed, by_force = of_cart(USUAL, friction=0.7)
    rubbed, _ = of_cart(USUAL._replace(friction=0.7))
    assert by_force.tolist() == B.tolist()
    assert pushed == pytest.approx(rubbed)


def test_a_state_at_rest_need_not_be_zero():
    def shifted(state, force, torque, constants):
        moved = state._replace(x=state.x - 2.0, theta=state.theta - 0.3)
        return accelerations(moved, force, torque, constants)

    rest = PlantState(2.0, 0.3, 0.0, 0.0)
    assert linearised(shifted, USUAL, rest, 0)[0] == pytest.approx(A, abs=1e-8)

    class Shifted(CartSimulator):
        kind = replace(PLANT, accelerations=shifted, rest=rest)

    for config in (feedback(GAINS), FuzzyConfig(update_rate=1.0 / H, derivative_mode="error")):
        moved = loop_of(Shifted(update_rate=1.0 / H), config)
        assert moved.matrix() == pytest.approx(loop(config).matrix(), rel=1e-6, abs=1e-6)


def test_the_trunk_is_linearised_by_the_same_function():
    masses = {"trunk_mass": 0.7, "length": 1.3}
    a, b = of_trunk(prescribed, **masses)
    assert linearise(TrunkSimulator(**masses))[:2] == (a[3, 1], b[3])
    a, _ = of_trunk(**masses)
    expected, _ = of_cart(CartPole(2.0, 0.7, 1.3, 9.81, 0.0))
    assert a[2:, 1] == pytest.approx(expected[2:, 1] * [-1.0, 1.0], rel=1e-9)


def test_a_plant_without_finite_accelerations_is_refused():
    for change in ({"length": 0.0}, {"gravity": inf}):
        with pytest.raises(
            PlanError, match=r"at rest are not finite with CartPole\(cart_mass=2\.0, "
        ):
            of_cart(USUAL._replace(**change))


def test_its_lqr_has_the_known_gains():
    assert pytest.approx([-33.333, 197.873, -36.121, 40.138], abs=5e-4) == GAINS
    slow, fast = np.sort_complex(np.linalg.eigvals(A - np.outer(B, GAINS)))[[3, 1]]
    assert (slow, fast) == (
        pytest.approx(-1.42995 + 1.07095j, abs=1e-4),
        pytest.approx(-9.60876 + 3.18199j, abs=1e-4),
    )


@pytest.mark.parametrize("largest", [LARGEST, (1.0, 0.05, 3.0, 0.4)], ids=str)
@pytest.mark.parametrize("plant", [USUAL, CartPole(1.5, 0.4, 0.8, 9.0, 0.7)])
def test_python_control_finds_the_same_gains(largest, plant):
    control = pytest.importorskip("control", reason="python-control: pip install control")
    a, b = of_cart(plant)
    q, r = np.diag(np.power(largest, -2.0)), np.array([[EFFORT**-2]])
    gains, _, _ = control.lqr(a, b[:, None], q, r)
    assert by_state(a, b, largest, EFFORT) == pytest.approx(gains[0], rel=1e-6)
    period = 0.02
    ad, bd, qd, nd, rd = sampled(a, b[:, None], q, r, period)
    gains, _, _ = control.dlqr(ad, bd, qd, rd, nd)
    assert by_state(a, b, largest, EFFORT, period) == pytest.approx(gains[0], rel=1e-6)


def test_discrete_gains_approach_the_continuous_ones_and_hold_at_any_rate():
    assert by_state(A, B, LARGEST, EFFORT, 1e-6) == pytest.approx(GAINS, rel=1e-4)
    for period in (0.01, 0.3):
        ad, bd = held_over(A, B, period)
        held = by_state(A, B, LARGEST, EFFORT, period)
        assert np.max(np.abs(np.linalg.eigvals(ad - np.outer(bd, held)))) < 1.0
        radius = np.max(np.abs(np.linalg.eigvals(ad - np.outer(bd, GAINS))))
        assert (radius < 1.0) == (period < 0.1)


@pytest.mark.parametrize("period", [0.0, 0.01])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_torque_on_the_trunk_cannot_hold_the_hip(period, friction):
    """Of hip and trunk on level ground the common momentum stays as it is."""
    a, b = of_trunk(friction=friction)
    assert not controllable(a, b)
    with pytest.raises(TuningError, match="its command cannot move one without the other"):
        by_state(a, b, LARGEST, EFFORT, period)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
def test_units_do_not_decide_what_is_controllable(scale):
    """Of length and time: gravity is what makes the cart-pole controllable."""
    plant = CartPole(2.0, 0.1, 0.5 * scale, 9.81 / scale, 0.0)
    assert controllable(*of_cart(plant))
    assert not controllable(*of_cart(plant._replace(gravity=0.0)))


@pytest.mark.parametrize(
    ("largest", "says"),
    [
        ((1e-6,) * 4, "no LQR gains for the largest values 1e-06, 1e-06, .*, 1e[+]06 "),
        ((0.3, 0.0, 1.0, 1.0), "greater than 0"),
    ],
    ids=str,
)
def test_impossible_weights_are_refused(largest, says):
    with pytest.raises(TuningError, match=says):
        by_state(A, B, largest, 1e6)


def test_the_loop_is_that_of_the_exponentials():
    ad, bd = held_over(A, B)
    closed = loop(feedback(GAINS))
    assert closed.a.shape == (5, 5)
    expected = np.linalg.eigvals(ad - np.outer(bd, GAINS))
    eigenvalues = np.linalg.eigvals(closed.matrix())
    for value in expected:
        assert np.min(np.abs(eigenvalues - value)) < 1e-8
    assert closed.radius() == pytest.approx(np.max(np.abs(expected)), abs=1e-9)


def test_friction_of_the_drive_acts_on_the_coordinate_that_it_pushes():
    ad, bd = held_over(A, B)
    ad[:, 2] -= 3.0 * bd  # held over a period
    expected = np.linalg.eigvals(ad - np.outer(bd, GAINS))
    closed = loop(feedback(GAINS), viscous_friction=3.0)
    assert closed.radius() == pytest.approx(np.max(np.abs(expected)), abs=1e-9)


def test_a_coordinate_that_nothing_depends_on_is_left_out():
    pid = PidConfig(update_rate=1.0 / H, p=60.0, i=0.0, d=12.0)
    alone = loop(pid)
    assert alone.a.shape == (3, 3)
    assert (alone.stable, alone.held) == (True, 0)
    rubbed = loop(pid, friction=0.5)  # the angle depends on the cart's rate
    assert rubbed.a.shape == (4, 4)
    assert rubbed.held == 0
    angle_alone = loop(feedback((0.0, 60.0, 0.0, 12.0)))
    assert angle_alone.matrix() == pytest.approx(alone.matrix(), abs=1e-12)
    rate = loop(feedback((0.0, 60.0, -3.0, 12.0)))
    assert rate.a.shape == (4, 4)
    everything = loop(feedback(GAINS))
    assert everything.held == 1
    assert everything.step_response(3)[0] == 0.0


def test_a_step_of_the_reference_lifts_the_angle_first():
    closed = loop(feedback(GAINS))
    angles = closed.step_response(8000)
    assert angles[100] > 0.1
    assert angles[-1] == pytest.approx(0.0, abs=1e-2)  # a leaning pole would drive the cart away


def test_margins_are_edges():
    closed = loop(feedback(GAINS))
    found = margins(closed)
    assert 0.0 < found.gain_down < 0.7
    assert found.gain_up > 10.0
    for factor, stable in (
        (0.999 * found.gain_up, True),
        (1.001 * found.gain_up, False),
        (1.001 * found.gain_down, True),
        (0.999 * found.gain_down, False),
    ):
        assert loop(feedback([factor * gain for gain in GAINS])).stable == stable
    for extra, stable in ((0, True), (1, False)):
        delayed = replace(closed, delay=round(found.delay / H) + extra)
        assert delayed.stable == stable


@pytest.mark.parametrize("delay", [0, 3])
def test_python_control_takes_the_loop(delay):
    control = pytest.importorskip("control", reason="python-control: pip install control")
    closed = replace(loop(feedback(GAINS)), delay=delay)
    taken = closed.to_control()
    w = np.geomspace(0.1, 600.0, 50)
    assert taken(np.exp(1j * w * H)) == pytest.approx(closed.response(w), rel=1e-6)
    poles = np.max(np.abs(control.feedback(taken).poles()))
    assert poles == pytest.approx(closed.radius(), abs=1e-6)


def run(config, seconds=10.0):
    """Return the states and commands of the nonlinear cart-pole, let go at 10 degrees."""
    controller, state, states, commands = (
        Controller(config),
        PlantState(0.0, radians(10.0), 0.0, 0.0),
        [],
        [],
    )
    for k in range(round(seconds / H)):
        answer = controller.update(
            k * 1_000_000, state.theta, state.theta_dot, 0.0, Hip(state.x, state.x_dot)
        )
        states.append(state)
        commands.append(answer.effort)
        state = advance(state, answer.effort, 0.0, H, 1, USUAL, accelerations)
    return np.array(states), np.array(commands)


@pytest.mark.slow
def test_it_holds_pole_and_cart_where_a_pid_lets_the_cart_go():
    states, commands = run(feedback(GAINS))
    assert np.max(np.abs(states[:, 0])) == pytest.approx(0.18, abs=0.005)
    assert np.max(np.abs(commands)) == pytest.approx(34.5, abs=0.1)
    assert np.max(np.abs(states[-1])) < 1e-4
    states, _ = run(PidConfig(update_rate=1.0 / H, p=60.0, i=0.0, d=12.0))
    assert abs(states[-1, 0]) == pytest.approx(5.25, abs=0.01)
    assert abs(states[-1, 1]) < 1e-3


@pytest.mark.parametrize("hip", [prescribed, passive])
def test_on_the_trunk_it_has_the_margins_of_lqr_and_cannot_hold_the_hip(hip):
    simulator = TrunkSimulator(update_rate=1000.0)
    config = StateFeedbackConfig(update_rate=1000.0)
    alone, lqr = (loop_of(simulator, c, hip) for c in (config, LqrConfig(update_rate=1000.0)))
    assert alone.matrix().tolist() == lqr.matrix().tolist()
    both = loop_of(simulator, replace(config, x=-3.0, v=-2.0), hip)
    assert both.a.shape == (5, 5)
    assert not both.stable
    other = loop_of(simulator, replace(config, hip_joint="trunk", x=4.0, v=1.0, p=57.7853), hip)
    assert other.a.shape == (3, 3)
    shared = loop_of(simulator, replace(config, d=config.d + 1.0), hip)
    assert other.matrix() == pytest.approx(shared.matrix(), abs=1e-9)


def test_a_model_of_a_path_is_not_feedback_of_the_hip():
    config = ComputedTorqueConfig(cosines=(0.004, -0.012), sines=(-0.003, 0.02))
    assert loop_of(TrunkSimulator(), config, passive).a.shape == (3, 3)


def test_a_driven_hip_that_is_fed_back_has_no_multipliers():
    assert prepared(make_plan("fig6", "state_feedback")).uses_hip
    plan = make_plan("fig6", "state_feedback", settings=["state_feedback.gains.v=-1"])
    with pytest.raises(PlanError, match=r"gains\.x, gains\.v: .* set both to 0"):
        prepared(plan)


def tune(*words):
    return CliRunner().invoke(trunk, ["tune", "lqr", *map(str, words)])


def test_tune_says_why_the_trunk_has_no_such_gains(command_says):
    code, _, err = command_says("tune", "lqr", "--controller", "state_feedback")
    assert code == 2
    assert re.fullmatch(
        r"trunk: error: no gains of state_feedback hold .* lqr holds the angle alone\n", err
    )


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--position", "1"], "lqr holds the angle alone: leave out --position"),
        (["--controller", "state_feedback", "--integral", "1"], "integral: leave out --integral"),
    ],
    ids=str,
)
def test_options_of_the_other_law_are_refused(words, says, command_says):
    code, _, err = command_says("tune", "lqr", *words)
    assert code == 2
    assert says in err


def on_a_cart(*words):
    return tune(*words, *(word for setting in ON_A_CART for word in ("--set", setting)))


@pytest.fixture
def on_an_arm(monkeypatch):
    """Let the cart-pole's first coordinate turn."""
    arm = replace(PLANT, coordinates=(Coordinate("arm", "rad"), PLANT.coordinates[1]))
    monkeypatch.setattr(PLANTS, "named", lambda name: arm)


BY_POSITION = "--controller", "state_feedback", "--position"


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        (("20cm",), "it is a length; an angle in rad is needed"),
        (("20deg", "--velocity", "1m/s"), "it is a speed; an angular speed in rad/s is needed"),
        (("20deg", "--torque", "5N"), "it is a force; a torque in N m is needed"),
    ],
)
def test_the_largest_values_are_in_the_units_of_a_plant_that_turns(on_an_arm, words, wrong):
    gains = [
        re.findall(r"gains\.\w +\S+", on_a_cart(*BY_POSITION, *given).stdout)
        for given in (("20deg", "--velocity", "60deg/s"), (pi / 9, "--velocity", pi / 3))
    ]
    assert len(gains[0]) == 5
    assert gains[0] == gains[1]
    refused = on_a_cart(*BY_POSITION, *words)
    assert refused.exit_code == 2
    assert wrong in refused.output


def test_the_largest_force_is_in_newtons():
    assert on_a_cart(*BY_POSITION, "20cm", "--torque", "5N").exit_code == 0
    assert "it is a torque; a force in N is" in on_a_cart("--torque", "5 N m").output
    assert "it is a force; a torque in N m is" in tune("--torque", "5 N").output


def test_gains_that_the_sampled_loop_cannot_have_come_with_a_remedy():
    heavy = "--controller", "state_feedback", "--torque", "1e5"
    said = "unstable: the gains are made without the rate and delays: give less for --torque, or --discrete"
    assert said in on_a_cart(*heavy).stderr
    late = on_a_cart(*heavy, "--discrete", "--set", "simulator.sensor.delay=0.1").stderr
    assert "unstable: the gains are made without delays: give less for --torque\n" in late
    assert "give less" not in on_a_cart(*heavy, "--discrete").stderr


def test_tune_writes_all_gains_to_a_file(tmp_path):
    path = tmp_path / "gains.yaml"
    words = "--controller", "state_feedback", "--torque", EFFORT
    done = on_a_cart(*words, "-o", path)
    assert done.exit_code == 0, done.output
    assert re.search(r"gains\.x +-33\.3333\n", done.stdout)
    config = make_plan("fig6", "state_feedback", [str(path)], ON_A_CART).controller
    assert [config.x, config.p, config.v, config.d] == pytest.approx(GAINS)
    assert (config.i, config.hip) == (0.0, "cart")
    assert re.search(r"gains\.x +-29\.88\n", on_a_cart(*words, "--discrete", "--rate", 100).stdout)
    friction = "--set", "simulator.actuator.viscous_friction=5"
    assert re.search(r"gains\.v +-4[0-9.]+\n", on_a_cart(*words, *friction).stdout)


def test_the_margins_are_those_of_the_plant_and_have_its_words(command_says):
    done = on_a_cart("--controller", "state_feedback", "--torque", EFFORT)
    assert "linearised cart-pole\n" in done.stdout
    assert re.search(r"\n  at +cart  ", done.stdout)
    (row,) = re.findall(r"\n  state_feedback +(\w+) +[\d.]+ to [\d.]+ ", done.stdout)
    assert row == "passive"
    assert not done.stderr
    words = "margins", "--set", *ON_A_CART, "--controller", "lqr"
    _, _, err = command_says(*words, "--set", "lqr.gains.p=3")
    assert "lqr: model.gravity_torque is the trunk's, not of the cart_pole: set it to 0" in err
    assert "lqr, cart passive: UNSTABLE" in err
    assert "lqr does not hold the cart, which may go anywhere" in err


@pytest.mark.parametrize("verb", [["lqr"], ["poles"], ["relay", "--lag", "0.02", "--damping", "2"]])
def test_a_plant_that_cannot_be_prescribed_is_refused_by_name(verb, command_says):
    code, _, err = command_says("tune", *verb, "--set", *ON_A_CART)
    assert code == 2
    assert re.fullmatch(
        r"trunk: error: plant\.name: cart_pole: its cart cannot be prescribed: .*\n", err
    )


def test_a_search_keeps_the_signs_of_gains_and_leaves_zeros():
    space = own_space(StateFeedbackConfig(p=200.0, i=0.0, d=40.0, x=-33.0, v=-36.0))
    values = space.values(np.array(space.start))
    assert values == pytest.approx(
        {"gains.p": 200.0, "gains.d": 40.0, "gains.x": -33.0, "gains.v": -36.0}
    )
    assert all(
        low < start < high for (low, high), start in zip(space.bounds, space.start, strict=True)
    )
