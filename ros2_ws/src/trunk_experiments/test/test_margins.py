"""Sampled loops about the upright: against transfer functions, the maps' multipliers, and runs."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import signal
from scipy.linalg import expm

from trunk_control.lqr import LqrConfig
from trunk_control.pid import Gains, PidConfig
from trunk_core.errors import NotInstalledError
from trunk_experiments.cli import trunk
from trunk_runs.plan import make_plan
from trunk_sim.config import TrunkSimulator
from trunk_sim.plants.trunk import passive, prescribed
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.tuning.floquet import floquet
from trunk_studies.tuning.linear import LinearLoop, linearise, loop_of
from trunk_studies.tuning.methods import by_poles
from trunk_studies.tuning.stability_margins import largest_delay, margins

from ...trunk_runs.test.stepwise import steps

PLANT = linearise(TrunkSimulator())


def sampled(gains: Gains, h: float, mode: str = "rate", delay: int = 0) -> LinearLoop:
    """Return a PID loop around the default trunk; ``delay`` in periods."""
    config = PidConfig(update_rate=1.0 / h, p=gains.p, i=gains.i, d=gains.d, derivative_mode=mode)
    simulator = TrunkSimulator(update_rate=1.0 / h, delay=delay * h)
    return loop_of(simulator, config)


def by_hand(gains: Gains, h: float, mode: str, delay: int) -> list[complex]:
    """Return the closed loop's poles z that are not 0, from transfer functions: another way."""
    a, b = PLANT.matrices()
    held = expm(np.block([[a, b], [np.zeros((1, 3))]]) * h)
    angle, open_loop = signal.ss2tf(held[:2, :2], held[:2, 2:], np.eye(2), np.zeros((2, 1)))
    # kp e + ki h z / (z - 1) e + kd D, all over z (z - 1).
    integral = np.polyadd(gains.p * np.array([1.0, -1.0, 0.0]), [gains.i * h, 0.0, 0.0])
    slope = gains.d * np.array([1.0, -1.0, 0.0])
    feedback = np.polymul(integral, angle[0])
    if mode == "rate":
        feedback = np.polyadd(feedback, np.polymul(slope, angle[1]))
    else:
        feedback = np.polyadd(
            feedback, np.polymul(gains.d / h * np.array([1.0, -2.0, 1.0]), angle[0])
        )
    late = np.zeros(delay + 1)
    late[0] = 1.0
    poles = np.roots(
        np.polyadd(np.polymul(np.polymul([1.0, -1.0, 0.0], late), open_loop), feedback)
    )
    return sorted(np.abs(poles[np.abs(poles) > 1e-4]))


LOOPS = [
    (Gains(60.0, 100.0, 9.0), 0.001, "rate"),
    (Gains(60.0, 100.0, 9.0), 0.005, "measurement"),
    (Gains(60.0, 36.0, 400.0), 0.001, "rate"),
    (Gains(80.0, 0.0, 6.0), 0.002, "rate"),
]


@pytest.mark.parametrize(("gains", "h", "mode"), LOOPS, ids=str)
@pytest.mark.parametrize("delay", [0, 3])
def test_the_poles_are_those_of_the_transfer_functions(gains, h, mode, delay):
    loop = sampled(gains, h, mode, delay)
    poles = np.abs(np.linalg.eigvals(loop.matrix()))
    expected = by_hand(gains, h, mode, delay)
    assert loop.radius() == pytest.approx(
        max(x for x in expected if abs(x - 1.0) > 1e-6 or gains.i), rel=1e-8
    )
    for pole in sorted(poles)[-2:]:
        assert min(abs(pole - x) for x in expected) < 1e-7


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("controller", "settings"),
    [
        ("pid", []),
        ("pid", ["pid.gains.i=0.0", "simulator.sensor.delay=60ms"]),
        ("pid", ["pid.derivative_filter_time=1s", "pid.derivative_mode=error"]),
        ("fuzzy_pid", ["simulator.sensor.delay=7ms", "fuzzy_pid.update_rate=100"]),
        ("computed_torque", ["simulator.actuator.time_constant=30ms"]),
        ("lqr", ["simulator.actuator.viscous_friction=0.3", "simulator.sensor.delay=3ms"]),
    ],
    ids=str,
)
@pytest.mark.slow
def test_margins_and_maps_use_one_linear_model(controller, settings):
    level_hip = ["simulator.hip.mode=prescribed", "simulator.path.amplitude=0.0"]
    plan = make_plan(
        "fig6", controller, ["profile_practical"], [*level_hip, *settings], {"update_rate": 500.0}
    )
    loop = loop_of(plan.simulator, plan.controller)
    assert loop.radius() == pytest.approx(floquet(plan).radius, abs=1e-9)


def test_the_response_belongs_to_the_matrix():
    """det(z - closed) / det(z - open) = 1 + L(z)."""
    loop = sampled(Gains(60.0, 100.0, 9.0), 0.002, "error", 3)
    closed, opened = loop.matrix(), replace(loop, factor=0.0).matrix()
    frequency = np.array([2.0, 9.0, 70.0])
    for w, response in zip(frequency, loop.response(frequency), strict=True):
        z = np.exp(1j * w * loop.h) * np.eye(len(closed))
        ratio = np.linalg.det(z - closed) / np.linalg.det(z - opened)
        assert ratio == pytest.approx(1.0 + response, rel=1e-9)


def test_a_linear_step_is_a_small_step_of_the_loop():
    plan = make_plan(
        "fig6",
        "lqr",
        ["profile_practical"],
        [
            "simulator.path.amplitude=0.0",
            "simulator.initial.position=[0.0, 0.0]",
            "simulator.initial.velocity=[0.0, 0.0]",
            "lqr.reference.profile=constant",
            "lqr.reference.value=1e-5",
            "simulator.sensor.delay=4ms",
            "simulator.actuator.time_constant=20ms",
        ],
        {"update_rate": 500.0, "duration": 1.0},
    )
    angles = np.array([step.truth.position[1] for step in steps(plan)]) / 1e-5
    loop = loop_of(plan.simulator, plan.controller, plan.simulator.accelerations)
    assert loop.step_response(len(angles)) == pytest.approx(angles, abs=1e-6)


def test_the_passive_hip_is_easier_to_lose():
    """Of the default LQR at 1 kHz: factors on all gains, from an independent computation."""
    config, simulator = LqrConfig(update_rate=1000.0), TrunkSimulator(update_rate=1000.0)
    found = [margins(loop_of(simulator, config, hip)).gain_up for hip in (prescribed, passive)]
    assert found == pytest.approx([107.3, 85.9], abs=0.1)


def test_filters_and_delays_count():
    """Stable by their gains alone; the runs with them fall."""
    plan = make_plan("fig6", "pid", ["profile_practical"])
    gains = by_poles(linearise(plan.simulator), (-12.0, -8.0, -2.0))
    tuned = replace(plan.controller, p=gains.p, i=gains.i, d=gains.d)
    late = replace(plan.simulator, delay=0.06)
    assert loop_of(plan.simulator, tuned).stable
    slow = replace(tuned, derivative_filter_time=1.0)
    assert loop_of(plan.simulator, slow).radius() > 1.0
    assert loop_of(late, tuned).radius() == pytest.approx(1.00068, abs=1e-5)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("gains", "h", "mode"), LOOPS, ids=str)
@pytest.mark.slow
def test_a_simulation_confirms_the_largest_delay(gains, h, mode):
    loop = sampled(gains, h, mode)
    limit = largest_delay(loop)
    assert margins(loop).delay == pytest.approx(limit * h)
    for delay, dies in ((limit, True), (limit + 1, False)):
        radius = replace(loop, delay=delay).radius()
        assert (radius < 1.0) == dies
        settings_ = [
            "simulator.substeps=1",
            "simulator.hip.mode=prescribed",
            "simulator.path.amplitude=0.0",
            "simulator.initial.position=[0.0, 1.0e-9]",
            "simulator.initial.velocity=[0.0, 0.0]",
            f"simulator.sensor.delay={delay * h}",
            *(
                f"pid.gains.{n}={v}"
                for n, v in zip("pid", (gains.p, gains.i, gains.d), strict=True)
            ),
            f"pid.derivative_mode={mode}",
            "pid.u_clamp_max=.inf",
            "pid.u_clamp_min=-.inf",
        ]
        # Until the slowest mode has changed a hundredfold, if that is not too long.
        periods = min(int(5.0 / abs(np.log(radius))), 4000)
        plan = make_plan(
            "fig6", "pid", [], settings_, {"update_rate": 1.0 / h, "duration": 4 * periods * h}
        )
        angles = np.abs(run_compiled(plan).table.theta)
        quarter = len(angles) // 4
        assert (np.max(angles[-quarter:]) < np.max(angles[quarter : 2 * quarter])) == dies


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "poles", [(-12.0, -8.0, -2.0), (-3.0, -4.0), (-1.0, -2.0), (-20.0, -1.0), (-30.0, -7.0, -0.2)]
)
@pytest.mark.parametrize("mode", ["rate", "measurement"])
def test_the_largest_delay_equals_a_step_by_step_search(poles, mode):
    loop = sampled(by_poles(PLANT, poles), 0.005, mode)
    counted = next(d for d in range(60) if not replace(loop, delay=d + 1).stable)
    assert largest_delay(loop) == counted > 1
    assert largest_delay(loop, limit=2) == 2


def test_a_slow_loop_has_a_phase_margin():
    """Its only crossover lies at a thousandth of the Nyquist frequency."""
    loop = sampled(by_poles(PLANT, (-1.0, -2.0)), 0.002)
    (crossover,) = loop.crossovers()
    assert crossover * loop.h / np.pi < 1.2e-3
    found = margins(loop)
    assert np.radians(found.phase_deg) / crossover == pytest.approx(found.delay, abs=loop.h)
    assert found.modulus < 2.0 * np.sin(np.radians(found.phase_deg) / 2.0) + 1e-9


def test_margins_of_an_unstable_loop_are_refused():
    with pytest.raises(ValueError, match="unstable"):
        margins(sampled(Gains(100.0, 0.0, 0.0), 0.001))


def test_gain_margins_are_edges():
    loop = sampled(Gains(60.0, 36.0, 400.0), 0.001)
    found = margins(loop)
    for factor, stable in (
        (0.999 * found.gain_up, True),
        (1.001 * found.gain_up, False),
        (1.001 * found.gain_down, True),
        (0.999 * found.gain_down, False),
    ):
        gains = Gains(*(factor * gain for gain in (60.0, 36.0, 400.0)))
        assert sampled(gains, 0.001).stable == stable


def said(*arguments):
    """Return a command's output and its warnings."""
    result = CliRunner().invoke(trunk, ["margins", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout, result.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "warning"),
    [
        (["pid.gains.i=100", "pid.gains.d=2.5"], "pid, hip prescribed: thin margins: phase margin"),
        (["pid.gains.p=1"], "pid, hip prescribed: UNSTABLE, spectral radius 1."),
        (
            ["simulator.link.state.delay=5ms"],
            "link.state, link.command and sensor.dropout are left",
        ),
        (["simulator.actuator.dead_band=1"], "actuator.dead_band, resolution, bias and coulomb"),
    ],
    ids=str,
)
def test_what_makes_margins_doubtful_is_said(settings, warning):
    given = (word for setting in settings for word in ("--set", setting))
    assert f"trunk: warning: {warning}" in said(*given)[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "plant", "warning"),
    [
        (
            "lqr",
            "trunk_mass=1.2",
            "lqr: model.gravity_torque is 4.905 N m, m g l of this plant 11.772",
        ),
        ("computed_torque", "length=0.6", "computed_torque: model.length is 1, plant.length 0.6"),
    ],
)
def test_gains_of_another_plant_are_named(controller, plant, warning):
    told = said("--controller", controller, "--set", f"simulator.plant.{plant}")[1]
    assert f"trunk: warning: {warning}" in told
    assert "model." not in said("--controller", controller)[1]


@pytest.mark.slow
def test_a_recording_has_the_margins_of_its_parameters(short_run, tmp_path):
    picture = tmp_path / "loop.svg"
    run = said(short_run("fig6", "fuzzy_pid"), "-o", picture)[0]
    rate = make_plan("fig6", "fuzzy_pid").controller.update_rate
    assert (
        run.replace(f"picture: {picture}\n", "")
        in said("--controller", "fuzzy_pid", "--params", "profile_paper", "--rate", rate)[0]
    )
    assert "Nyquist" in picture.read_text()


def test_a_controller_in_place_of_a_run_and_a_gain_by_its_usual_name_get_the_right_hint(
    command_says,
):
    code, _, err = command_says("margins", "pid")
    assert (code, err) == (2, "trunk: error: pid is a controller: give --controller pid\n")
    for setting, meant in (("pid.kp=3", "'gains.p'"), ("pid.gains.Ki=3", "'gains.i'")):
        code, _, err = command_says("margins", "--set", setting)
        assert code == 2
        assert f"did you mean {meant}?" in err


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("name", ["pid", "computed_torque"])  # with a memory, and without
def test_python_control_takes_the_loop(name, delay):
    control = pytest.importorskip("control", reason="python-control: pip install control")
    plan = make_plan("demo", name, settings=[f"simulator.sensor.delay={0.005 * delay}"])
    loop = loop_of(plan.simulator, plan.controllers[name])
    taken = loop.to_control()
    assert isinstance(taken, control.StateSpace)
    assert taken.dt == loop.h
    w = np.geomspace(0.1, 600.0, 50)
    assert taken(np.exp(1j * w * loop.h)) == pytest.approx(loop.response(w), rel=1e-9)
    poles = control.feedback(taken).poles()
    eigenvalues = np.linalg.eigvals(loop.matrix())
    assert np.max(np.abs(poles)) == pytest.approx(np.max(np.abs(eigenvalues)), abs=1e-9)


def test_without_python_control_one_line_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(NotInstalledError) as caught:
        sampled(Gains(60.0, 100.0, 9.0), 0.005).to_control()
    assert str(caught.value) == (
        "python-control is not installed: pip install trunk_experiments[control]"
    )
