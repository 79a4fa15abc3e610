"""The equations of motion against a symbolic derivation from the Lagrangian (paper, eq. 7)."""

from itertools import pairwise
from math import log2, pi

import mpmath
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_core.mechanics import Body
from trunk_sim.plant import PlantState, advance, rk4_step
from trunk_sim.plants.trunk import energy, passive, prescribed


class Lagrangian:
    """The model, derived by sympy alone and evaluated with 40 digits."""

    def __init__(self, count: int = 0) -> None:
        """Derive it for a path with so many harmonics."""
        t = sp.Symbol("t")
        x, theta = sp.Function("x")(t), sp.Function("theta")(t)
        coefficients = sp.symbols(f"c:{2 * count}")
        constants = (*sp.symbols("M m l g A k"), *coefficients)
        M, m, length, g, A, k = constants[:6]
        force, torque = sp.symbols("F tau")
        y = A * sp.sin(k * x)
        for n, (a, b) in enumerate(zip(coefficients[::2], coefficients[1::2], strict=True), 1):
            y += a * sp.cos(n * k * x) + b * sp.sin(n * k * x)
        com_x, com_y = x + length * sp.sin(theta), y + length * sp.cos(theta)

        def speed_squared(*position):
            return sum(sp.diff(p, t) ** 2 for p in position)

        kinetic = M / 2 * speed_squared(x, y) + m / 2 * speed_squared(com_x, com_y)
        potential = M * g * y + m * g * com_y
        lagrangian = kinetic - potential

        def residual(q, generalized_force):
            momentum = sp.diff(lagrangian, sp.diff(q, t))
            return sp.diff(momentum, t) - sp.diff(lagrangian, q) - generalized_force

        names = sp.symbols("x theta x_dot theta_dot x_ddot theta_ddot")
        plain = [
            (sp.diff(x, t, 2), names[4]),
            (sp.diff(theta, t, 2), names[5]),
            (sp.diff(x, t), names[2]),
            (sp.diff(theta, t), names[3]),
            (x, names[0]),
            (theta, names[1]),
        ]
        rows = [residual(x, force).doit().subs(plain), residual(theta, torque).doit().subs(plain)]
        mass_matrix, right_side = sp.linear_eq_to_matrix(rows, names[4:])
        arguments = (names[:4], force, torque, constants)
        self._system = sp.lambdify(arguments, (mass_matrix, right_side), "mpmath")
        total = (kinetic + potential).doit().subs(plain)
        self._energy = sp.lambdify((names[:4], constants), total, "mpmath")

    def accelerations(self, equations, state, force, torque, p) -> tuple[float, float]:
        with mpmath.workdps(40):
            exact = [mpmath.mpf(v) for v in state], force, torque, self._constants(p)
            mass, right = self._system(*exact)
            if equations is prescribed:
                return 0.0, float(right[1] / mass[1, 1])
            return tuple(float(v) for v in mpmath.lu_solve(mass, right))

    def energy(self, state, p) -> float:
        with mpmath.workdps(40):
            return float(self._energy([mpmath.mpf(v) for v in state], self._constants(p)))

    @staticmethod
    def _constants(p):
        return [mpmath.mpf(v) for v in (*p[:6], *(p.harmonics or ()))]


@pytest.fixture(scope="module")
def lagrangian() -> Lagrangian:
    return Lagrangian()


@pytest.fixture(scope="module")
def series() -> Lagrangian:
    return Lagrangian(3)


def between(low: float, high: float):
    return st.floats(low, high, allow_subnormal=False)


states = st.builds(PlantState, between(-20, 20), between(-7, 7), between(-5, 5), between(-15, 15))
parameters = st.builds(
    Body,
    hip_mass=between(0.2, 20),
    trunk_mass=between(0.1, 5),
    length=between(0.2, 3),
    gravity=between(0, 25),
    amplitude=between(-2, 2),
    wavenumber=between(0, 3),
    harmonics=st.none(),
)
harmonics = st.tuples(*[between(-0.5, 0.5)] * 6)
TOLERANCE = 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("equations", [passive, prescribed])
@given(states, between(-100, 100), between(-100, 100), parameters)
@settings(max_examples=150)
def test_accelerations_follow_from_the_lagrangian(lagrangian, equations, state, force, torque, p):
    actual = equations(state, force, torque, p)
    expected = lagrangian.accelerations(equations, state, force, torque, p)
    largest = max(map(abs, expected))
    # Terms of the size of g cancel: they set the scale of the round-off.
    assert actual == pytest.approx(expected, rel=0.0, abs=TOLERANCE * (largest + p.gravity) + 1e-30)


@pytest.mark.parametrize("equations", [passive, prescribed])
def test_accelerations_at_the_papers_initial_state(lagrangian, equations):
    state = PlantState(0.0, 0.5235987755982988, 1.0, 0.0)
    expected = lagrangian.accelerations(equations, state, 0.0, 0.0, Body())
    assert equations(state, 0.0, 0.0, Body()) == pytest.approx(expected, rel=TOLERANCE)


@given(states, parameters)
@settings(max_examples=100)
def test_energy_is_that_of_the_lagrangian(lagrangian, state, p):
    zero_level = 1.0 + p.gravity * (p.hip_mass + p.trunk_mass) * (abs(p.amplitude) + p.length)
    expected = lagrangian.energy(state, p)
    assert energy(state, p) == pytest.approx(expected, rel=TOLERANCE, abs=TOLERANCE * zero_level)


@pytest.mark.slow
@pytest.mark.parametrize("equations", [passive, prescribed])
@given(states, between(-100, 100), between(-100, 100), parameters, harmonics)
@settings(max_examples=60)
def test_accelerations_on_a_path_of_harmonics_follow_from_the_lagrangian(
    series, equations, state, force, torque, p, added
):
    p = p._replace(harmonics=added)
    actual = equations(state, force, torque, p)
    expected = series.accelerations(equations, state, force, torque, p)
    # The terms that cancel: the centrifugal one grows with the curvature, every one with the slope.
    steep = 1.0 + p.wavenumber * (abs(p.amplitude) + 3.0 * sum(map(abs, added)))
    scale = p.gravity + (3.0 * p.wavenumber * state.x_dot) ** 2 + max(map(abs, expected))
    tolerance = TOLERANCE * steep * steep * scale + 1e-30
    assert actual == pytest.approx(expected, rel=0.0, abs=tolerance)


@given(states, parameters, harmonics)
@settings(max_examples=60)
def test_energy_on_a_path_of_harmonics_is_that_of_the_lagrangian(series, state, p, added):
    p = p._replace(harmonics=added)
    highest = abs(p.amplitude) + sum(map(abs, added)) + p.length
    zero_level = 1.0 + p.gravity * (p.hip_mass + p.trunk_mass) * highest
    expected = series.energy(state, p)
    assert energy(state, p) == pytest.approx(expected, rel=TOLERANCE, abs=TOLERANCE * zero_level)


def test_a_free_trunk_on_a_path_of_harmonics_keeps_its_energy():
    p = Body(amplitude=0.3, wavenumber=2.0, harmonics=(0.05, -0.1, 0.04, 0.03, -0.02, 0.01))
    drift = []
    for h in (2e-3, 1e-3):
        state = PlantState(0.1, 0.4, 1.5, -0.3)
        begin = energy(state, p)
        worst = 0.0
        for _ in range(round(2.0 / h)):
            state = rk4_step(state, 0.0, 0.0, h, p, passive)
            worst = max(worst, abs(energy(state, p) - begin))
        drift.append(worst)
    assert drift[1] < 1e-7
    assert drift[0] / drift[1] > 12.0, (
        "the error of a fourth-order method alone: 2^4 at half the step"
    )


def test_flat_path_is_the_textbook_cart_and_pole():
    p = Body(amplitude=0.0)
    state = PlantState(3.0, 0.4, 0.7, -1.2)
    x_ddot, theta_ddot = passive(state, 2.0, 0.0, p)
    total, moment = sp.Rational(5, 2), sp.Rational(1, 2)
    sin, cos = sp.sin(sp.Float(0.4, 30)), sp.cos(sp.Float(0.4, 30))
    g, w = sp.Float("9.81", 30), sp.Float(1.2, 30)
    expected = (2 + moment * sin * (w**2 - g * cos)) / (total - moment * cos**2)
    assert x_ddot == pytest.approx(float(expected), rel=1e-12)
    assert theta_ddot == pytest.approx(float(g * sin - cos * expected), rel=1e-12)


def test_defaults_are_table_5_of_the_paper():
    p = Body()
    assert (p.hip_mass, p.trunk_mass, p.length) == (2.0, 0.5, 1.0)
    assert (p.gravity, p.amplitude, p.wavenumber) == (9.81, 1.0, 1.0)


PLANT = Body()
START = PlantState(0.0, pi / 6.0, 1.0, 0.0)


def run(steps: int, duration: float, equations=passive) -> PlantState:
    return advance(START, 0.5, 1.5, duration, steps, PLANT, equations)


@pytest.mark.parametrize("equations", [passive, prescribed])
def test_global_error_has_order_four(equations):
    exact = run(20_000, 1.0, equations)
    errors = [
        max(abs(a - b) for a, b in zip(run(steps, 1.0, equations), exact, strict=True))
        for steps in (50, 100, 200, 400)
    ]
    orders = [log2(a / b) for a, b in pairwise(errors)]
    assert orders == pytest.approx([4.0] * 3, abs=0.15)


def test_constant_acceleration_is_integrated_exactly():
    # No gravity, a straight path, a given hip: theta'' = torque / (m l^2), a quadratic in t.
    p = Body(gravity=0.0, amplitude=0.0)
    state = rk4_step(PlantState(0.25, 0.5, 1.5, -2.0), 0.0, 3.0, 0.5, p, prescribed)
    assert state == pytest.approx((1.0, 0.5 - 1.0 + 0.5 * 6.0 * 0.25, 1.5, 1.0), rel=1e-15)


def test_free_plant_keeps_its_energy():
    initial = energy(START, PLANT)
    state, drift = START, 0.0
    for _ in range(10_000):
        state = rk4_step(state, 0.0, 0.0, 1e-3, PLANT, passive)
        drift = max(drift, abs(energy(state, PLANT) - initial))
    assert state.theta != pytest.approx(START.theta, abs=0.1)  # it did move
    assert drift <= 1e-8


def test_held_torque_does_its_work():
    # A torque is conservative while it is held: E - torque * theta stays.
    torque, force = 2.0, -1.5
    state = START
    for _ in range(1000):
        state = rk4_step(state, force, torque, 1e-3, PLANT, passive)
    work = torque * (state.theta - START.theta) + force * (state.x - START.x)
    assert energy(state, PLANT) - energy(START, PLANT) == pytest.approx(work, abs=1e-8)


def test_prescribed_hip_keeps_its_speed():
    state = START
    for _ in range(2000):
        state = rk4_step(state, 50.0, 3.0, 1e-3, PLANT, prescribed)
    assert state.x_dot == START.x_dot
    assert state.x == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("substeps", [1, 3, 10])
def test_substeps_are_equal_steps(substeps):
    state = START
    for _ in range(substeps):
        state = rk4_step(state, 0.5, 1.5, 0.005 / substeps, PLANT, passive)
    assert advance(START, 0.5, 1.5, 0.005, substeps, PLANT, passive) == state
