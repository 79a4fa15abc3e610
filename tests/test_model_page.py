"""The equations of docs/model.md are those that the functions compute: parsed, and compared in numbers."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from trunk_control import rule_tables
from trunk_control.computed_torque import computed_torque_update
from trunk_control.fuzzy import infer
from trunk_control.fuzzy_pid import FuzzyPidConfig, inferred_gains
from trunk_control.law import ANTIWINDUP_BACK_CALCULATION, Hip, Limits, Sample
from trunk_control.lqr import lqr_update
from trunk_control.pid import PidConfig
from trunk_control.pid_family import Gains, PidState, combine, error_derivative
from trunk_control.state_feedback import state_feedback_update
from trunk_core.mechanics import (
    Body,
    equations_of_motion,
    forward_dynamics,
    inverse_dynamics,
    path_height,
    path_slope,
    prescribed_dynamics,
)
from trunk_sim.config import TrunkSimulator
from trunk_sim.disturbances import Disturbance
from trunk_sim.plant import PlantState
from trunk_sim.plants.trunk import energy
from trunk_sim.step import (
    Actuator,
    SensorParameters,
    actuator_torque,
    approach_of,
    sense,
    with_friction,
)
from trunk_studies.paper.errata import ERRATA
from trunk_studies.tuning.linear import linearise
from trunk_studies.tuning.methods import ziegler_nichols

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "model.md"
FUNCTIONS = {
    "sin": sp.sin,
    "cos": sp.cos,
    "exp": sp.exp,
    "floor": sp.floor,
    "sign": sp.sign,
    "abs": sp.Abs,
    "max": sp.Max,
    "min": sp.Min,
    "clamp": lambda value, low, high: sp.Min(sp.Max(value, low), high),
}
HARMONICS = 3
SEEDS = range(6)


def blocks(heading: str) -> list[list[tuple[str, str]]]:
    """The equations under a heading: of each block the rows, as (left side, right side)."""
    section = PAGE.read_text(encoding="utf-8").split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = []
    for block in re.findall(r"```math\n(.*?)```", section, re.DOTALL):
        lines = re.sub(r"\\(begin|end)\{aligned\}", "", block).split("\\\\\n")
        rows.append([tuple(line.replace("&", "").strip().split(" = ")) for line in lines])
    return rows


def expanded(latex: str) -> str:
    """A formula whose last term is a sum over n, with the sum written out."""
    head, marker, body = latex.partition(r"\sum_{n=1}^{N}")
    if not marker:
        return latex
    number = r"(?<![A-Za-z\\])n(?![A-Za-z])"
    return f"{head} ({' + '.join(re.sub(number, str(n), body) for n in range(1, HARMONICS + 1))})"


def python(latex: str) -> str:
    """A formula as Python."""
    text = re.sub(r"\\(?:left|right)(?![a-z])", "", expanded(latex))
    text = text.replace(r"\lfloor", "floor(").replace(r"\rfloor", ")")
    text = re.sub(r"\|([^|]+)\|", r"abs(\1)", text)
    text = re.sub(r"(?<![\w\\])e\^\{([^}]*)\}", r"exp(\1)", text)
    text = text.replace("^{+}", "_next").replace("''", "_pp").replace("'", "_p")
    text = re.sub(r"\\operatorname\{(\w+)\}", r"\1", text)
    text = re.sub(r"\\(dot|ddot|bar)\{\\?(\w+)\}", r"\2_\1", text)
    text = re.sub(
        r"_\{([^}]*)\}", lambda match: "_" + re.sub(r"\W+", "_", match[1]).strip("_"), text
    )
    text = re.sub(r"\^([a-z])", r"_\1", text)
    while match := re.search(r"\\frac\{([^{}]*)\}\{([^{}]*)\}", text):
        text = text.replace(match[0], f"(({match[1]})/({match[2]}))")
    text = re.sub(r"\\(sin|cos) *\\?([a-z]+)", r"\1(\2)", text)
    text = text.replace("\\", "").replace("{", "(").replace("}", ")").replace("^", "**")
    tokens = re.findall(r"\*\*|[A-Za-z]\w*|[\d.]+|\S", text)
    product = tokens[:1]
    for before, after in pairwise(tokens):
        factor = before == ")" or before[0].isalnum()
        call = before in FUNCTIONS and after == "("
        if factor and not call and (after == "(" or after[0].isalnum()):
            product.append("*")
        product.append(after)
    return " ".join(product)


def value(latex: str, numbers: dict[str, float]) -> float:
    """The value of a formula."""
    return float(sp.sympify(python(latex), locals={**numbers, **FUNCTIONS}))


def evaluated(block: list[tuple[str, str]], numbers: dict[str, float]) -> dict[str, float]:
    """The numbers and, row by row, the left sides of a block."""
    numbers = dict(numbers)
    for left, right in block:
        numbers[python(left)] = value(right, numbers)
    return numbers


def near(*numbers: float) -> object:
    return pytest.approx(numbers, rel=1e-11, abs=1e-11)


def drawn(seed: int) -> tuple[dict[str, float], Body, PlantState]:
    """A body with harmonics and a state, at random, and the page's symbols for them."""
    rng = np.random.default_rng(seed)
    names = ("M", "m", "l", "g", "A", "k")
    numbers = dict(zip(names, rng.uniform(0.2, 3.0, len(names)).tolist(), strict=True))
    harmonics = rng.uniform(-0.2, 0.2, 2 * HARMONICS).tolist()
    state = PlantState(*rng.uniform(-2.0, 2.0, 4).tolist())
    body = Body(*numbers.values(), harmonics=tuple(harmonics))
    for n in range(HARMONICS):
        numbers[f"a_{n + 1}"], numbers[f"b_{n + 1}"] = harmonics[2 * n : 2 * n + 2]
    motion = dict(zip(("x", "theta", "x_dot", "theta_dot"), state, strict=True))
    inputs = dict(zip(("tau", "F"), rng.uniform(-20.0, 20.0, 2).tolist(), strict=True))
    return {**numbers, **motion, **inputs}, body, state


def in_motion(numbers: dict[str, float]) -> dict[str, float]:
    """The symbols with those of the path and the coefficients of the equations of motion."""
    coefficients = blocks("Equations of motion")[1]
    for_path = evaluated(blocks("The hip's path")[0], numbers)
    # The harmonics' b_1 and b_2 make way for the right sides, which have the same names.
    return evaluated(coefficients, for_path)


@pytest.mark.parametrize("seed", SEEDS)
def test_path_and_equations_of_motion(seed):
    numbers, body, state = drawn(seed)
    symbols = in_motion(numbers)
    path = state.x, body.amplitude, body.wavenumber, body.harmonics
    assert near(path_height(*path), path_slope(*path)) == (symbols["y"], symbols["y_p"])
    names = ("a_11", "a_12", "a_22", "b_1", "b_2", "Delta")
    assert near(*equations_of_motion(*state, body)) == tuple(symbols[name] for name in names)
    system, _, passive, prescribed = blocks("Equations of motion")
    force, torque = symbols["F"], symbols["tau"]
    for mode, computed in (
        (passive, forward_dynamics(*state, force, torque, body)),
        (prescribed, prescribed_dynamics(*state, torque, body)),
    ):
        solution = evaluated(mode, symbols)
        assert near(*computed) == (solution["x_ddot"], solution["theta_ddot"])
    for left, right in system:
        solution = evaluated(passive, symbols)
        assert value(left, solution) == pytest.approx(value(right, solution), abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_energy(seed):
    numbers, body, state = drawn(seed)
    symbols = evaluated(blocks("Energy")[0], evaluated(blocks("The hip's path")[0], numbers))
    assert near(energy(state, body)) == (symbols["T"] + symbols["V"],)


@pytest.mark.parametrize("seed", SEEDS)
def test_sensors_and_drive(seed):
    rng = np.random.default_rng(seed)
    names = ("theta_k_d", "delta_k", "beta", "sigma", "n_k")
    numbers = dict(zip(names, rng.uniform(-1.0, 1.0, 5).tolist(), strict=True))
    late, offset, bias, deviation, sample = numbers.values()
    read = sense(
        PlantState(0.0, late, 0.0, 0.0),
        Disturbance(trunk_offset=offset),
        sample,
        0.0,
        SensorParameters(position_noise=deviation, position_bias=bias),
    )
    assert near(read.theta) == (evaluated(blocks("Sensors")[0], numbers)["theta_m_k"],)

    positive = ("d", "q", "tau_max", "r", "h", "T", "c_v", "c_c")
    numbers = dict(zip(positive, rng.uniform(0.1, 2.0, 8).tolist(), strict=True))
    signed = ("u", "b", "tau_k_1", "tau_d", "theta_dot")
    numbers |= dict(zip(signed, rng.uniform(-3.0, 3.0, 5).tolist(), strict=True))
    if seed % 2:
        numbers["theta_dot"] *= 1e-3
    d, q, limit, rate, h, lag, viscous, coulomb, u, bias, before, push, speed = numbers.values()
    drive = Actuator(approach_of(lag, h), rate * h, d, q, bias, coulomb, viscous)
    chain, joint = blocks("Drive")
    symbols = evaluated(joint, evaluated(chain, numbers))
    torque = actuator_torque(before, u, limit, drive)
    assert near(torque) == (symbols["tau_k"],)
    assert near(with_friction(torque + push, speed, drive)) == (symbols["tau"],)


@pytest.mark.parametrize("seed", SEEDS)
def test_sampled_controller(seed):
    rng = np.random.default_rng(seed)
    names = ("r_k", "theta_k", "e_k_1", "F_k_1", "I_k_1", "f_k")
    numbers = dict(zip(names, rng.uniform(-1.0, 1.0, 6).tolist(), strict=True))
    positive = ("h", "T_f", "K_p", "K_i", "K_d", "u_max", "T_t")
    numbers |= dict(zip(positive, rng.uniform(0.01, 1.0, 7).tolist(), strict=True))
    numbers["u_min"] = -numbers["u_max"]
    r, theta, before, filtered, integral, model, h, t_f, kp, ki, kd, limit, t_t, low = (
        numbers.values()
    )
    limits = Limits(
        0, t_f, low, limit, antiwindup=ANTIWINDUP_BACK_CALCULATION, tracking_time_constant=t_t
    )
    memory = PidState(integral, before, 0.0, filtered, 0.0, True)
    derivative = error_derivative(memory, r - theta, theta, 0.0, h, limits)
    after, terms = combine(
        memory, r - theta, theta, derivative, h, Gains(kp, ki, kd), 0.0, limits, model
    )
    past, command, tracking = blocks("The sampled controller")
    symbols = evaluated(past, numbers)
    symbols["D_k"] = symbols["F_k"]  # where there is a filter
    assert near(derivative) == (symbols["F_k"],)
    symbols = evaluated(tracking, evaluated(command, symbols))
    assert near(terms.unsaturated, terms.effort) == (symbols["u_k"], symbols["u_bar_k"])
    assert near(after.integral) == (symbols["I_next_k"],)


def test_pid_by_table_1():
    symbols = evaluated(blocks("PID")[0], {"K_u": 100.0, "T_u": 1.2})
    gains = symbols["K_p"], symbols["K_i"], symbols["K_d"]
    assert near(*ziegler_nichols(100.0, 1.2)) == gains
    assert near(*PidConfig().gains) == gains


@pytest.mark.parametrize("seed", SEEDS)
def test_fuzzy_gains(seed):
    config = FuzzyPidConfig()
    error, rate = np.random.default_rng(seed).uniform((-2.0, -6.0), (2.0, 6.0)).tolist()
    kp, kd, alpha = infer(error, rate, config.rules)
    numbers = {
        f"K_{n}_{end}": getattr(config.box, f"{n}_{end}") for n in "pd" for end in ("min", "max")
    }
    symbols = evaluated(
        blocks("Fuzzy-PID")[1], {**numbers, "K_p_p": kp, "K_d_p": kd, "alpha": alpha}
    )
    gains, _ = inferred_gains(error, rate, config.rules, config.box)
    assert near(*gains) == (symbols["K_p"], symbols["K_i"], symbols["K_d"])


def test_fuzzy_tables():
    rows = re.findall(r"^\| (?:[NP][BMS]|ZO) \| (.*) \|$", PAGE.read_text("utf-8"), re.MULTILINE)
    tables = [row.replace(" | ", " ") for row in rows]
    printed = rule_tables.KP_AS_PRINTED, rule_tables.KD_AS_PRINTED, rule_tables.ALPHA_AS_PRINTED
    assert tables == [row for table in printed for row in table]


@pytest.mark.parametrize("seed", SEEDS)
def test_lqr_and_computed_torque(seed):
    numbers, body, state = drawn(seed)
    rng = np.random.default_rng(seed)
    gains = Gains(*rng.uniform(0.0, 50.0, 3).tolist())
    sample = Sample(0.3, state.theta, state.theta_dot, 0.01, Hip(state.x, state.x_dot))
    fed = lqr_update(PidState(), sample, (Gains(0.0, 0.0, 0.0), 4.9), Limits())[1]
    symbols = evaluated(blocks("LQR")[0], {"G": 4.9, "r_k": 0.3})
    assert near(fed.effort) == (symbols["f_k"],)

    terms = computed_torque_update(PidState(), sample, (gains, body, False), Limits(derivative=2))[
        1
    ]
    error = 0.3 - state.theta
    law = {"e_k": error, "I_k": 0.01 * error, "D_k": -state.theta_dot}
    law |= dict(zip(("k_p", "k_i", "k_d"), gains, strict=True))
    symbols = evaluated(blocks("Computed torque")[0], {**in_motion(numbers), **law})
    assert near(*inverse_dynamics(*state, body), terms.effort) == (
        symbols["H"],
        symbols["c"],
        symbols["u_k"],
    )


def test_state_feedback():
    sample = Sample(0.3, 0.1, -0.4, 0.01, Hip(0.7, -1.1))
    constants = Gains(0.0, 0.0, 0.0), -30.0, 20.0
    terms = state_feedback_update(PidState(), sample, constants, Limits())[1]
    numbers = {"k_x": -30.0, "k_v": 20.0, "q_k": 0.7, "q_dot_k": -1.1}
    symbols = evaluated(blocks("State feedback")[0], numbers)
    assert near(terms.effort) == (symbols["f_k"],)


def test_linear_model():
    (((left, right),),) = blocks("Linear model, Bode and Nyquist")
    numbers = {"m": 0.7, "l": 1.3, "g": 9.81}
    linear = linearise(TrunkSimulator(trunk_mass=0.7, length=1.3))
    inertia = value(left, {**numbers, "theta_ddot": 1.0})
    weight, torque = (
        value(right, {**numbers, "theta": theta, "tau": 1.0 - theta}) for theta in (1.0, 0.0)
    )
    assert (weight / inertia, torque / inertia) == pytest.approx((linear.a, linear.b), rel=1e-6)


def test_each_function_that_an_equation_links_to_is_there():
    links = re.findall(r"\[(`[^\]]+`)\]\(\.\./(\S+\.py)\)", PAGE.read_text(encoding="utf-8"))
    assert len(links) > 20
    for names, path in links:
        for name in re.findall(r"`(\w+)`", names):
            assert f"\ndef {name}(" in (ROOT / path).read_text(encoding="utf-8"), (name, path)


def test_the_paper_page_lists_each_erratum_as_it_is_shown():
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    table = page.split("\n## Errata\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \|$", table, re.MULTILINE)[1:]
    letters = {r"\tau": "τ", "_": "", "{": "", "}": "", "$`": "", "`$": "", "row of τ": "τ row"}
    letters |= {"row of x": "x row"}
    places = []
    for where, *_ in rows:
        for latex, letter in letters.items():
            where = where.replace(latex, letter)
        places.append(where)
    assert places == [erratum.where for erratum in ERRATA]
    misprints = [", not a misprint" not in erratum.correct for erratum in ERRATA]
    assert misprints == [", not a misprint" not in correct for *_, correct in rows]
