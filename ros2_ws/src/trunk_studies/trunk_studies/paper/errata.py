"""The paper's misprints, each with the computation that shows it.

Two oracles: the equations of motion derived by SymPy from the paper's own Lagrangian (its eq. 7), and
numbers computed from what it prints elsewhere.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import sympy as sp  # type: ignore[import-untyped]

from trunk_control.pid import PidConfig
from trunk_control.rule_tables import INPUT_LABELS, KD_AS_PRINTED
from trunk_core.mechanics import Body
from trunk_sim.config import TrunkSimulator
from trunk_sim.plant import PlantState
from trunk_sim.plants.trunk import as_printed, passive

from ..tuning.linear import linearise, loop_of

KU, TU = 100.0, 1.2  # as printed, except for the sign: N m/rad, s


class Erratum(NamedTuple):
    """A misprint, or in one case an odd convention: where, what is printed, what is right.

    Formulas are between dollar signs, an index after ``_``; `plain` is the text without these.
    """

    where: str
    printed: str
    correct: str
    show: Callable[[], tuple[bool, str]]  # whether it is one, and the computation that shows it


def plain(text: str) -> str:
    """Return a text without the marks of its formulas: ``Kp,max = 0.6 Ku``."""
    return re.sub(r"[$_{}]", "", text)


@cache
def lagrange() -> dict[str, Any]:
    """Return the derived equations: rows ``x`` and ``theta`` (left sides), momentum, and the symbols.

    Each row is ``d/dt dL/dq' - dL/dq``, which equals the force on x and the torque on theta.
    """
    big, m, length, g = sp.symbols("M m l g", positive=True)
    names = ("x", "th", "xd", "thd", "xdd", "thdd")
    x, th, xd, thd, xdd, thdd = sp.symbols("x θ ẋ θ̇ ẍ θ̈", real=True)
    com_x, com_y = xd + length * thd * sp.cos(th), xd * sp.cos(x) - length * thd * sp.sin(th)
    kinetic = big * xd**2 * (1 + sp.cos(x) ** 2) / 2 + m * (com_x**2 + com_y**2) / 2
    potential = big * g * sp.sin(x) + m * g * (length * sp.cos(th) + sp.sin(x))
    lagrangian = kinetic - potential

    def row(q: sp.Symbol, rate: sp.Symbol) -> sp.Expr:
        momentum = sp.diff(lagrangian, rate)
        moved = sum(
            sp.diff(momentum, a) * b for a, b in ((x, xd), (th, thd), (xd, xdd), (thd, thdd))
        )
        return sp.simplify(moved - sp.diff(lagrangian, q))

    return {
        **dict(zip(names, (x, th, xd, thd, xdd, thdd), strict=True)),
        "M": big,
        "m": m,
        "l": length,
        "g": g,
        "row_x": row(x, xd),
        "row_th": row(th, thd),
        "momentum": sp.diff(lagrangian, thd),
    }


def mathematics(values: object) -> str:
    """Return expressions as they are written by hand, marked as a formula: ``$m l² sin(θ)$``."""
    text = str(values).replace("**2", "²").replace("*", " ").replace("-", "−")
    return f"${text}$"


def _row_difference(name: str, printed: Callable[[dict[str, Any]], Any]) -> tuple[bool, str]:
    """Return whether a printed row differs from the derived one, and by what."""
    s = lagrange()
    left = sp.simplify(sp.expand(printed(s) - s[name]))
    return left != 0, f"printed minus derived (SymPy, from eq. 7) = {mathematics(left)}, not 0"


def _force() -> tuple[bool, str]:
    s = lagrange()
    inertia = sp.expand(s["row_th"]).coeff(s["thdd"])
    return (
        sp.diff(s["momentum"], s["thdd"]) == 0 and sp.simplify(inertia - s["m"] * s["l"] ** 2) == 0,
        f"(1) has {mathematics(inertia)} $θ̈$ on its left, a torque in N·m; the momentum $∂L/∂θ̇$ has no $θ̈$",
    )


def _torque_row() -> tuple[bool, str]:
    return _row_difference(
        "row_th",
        lambda s: (
            s["xd"] * s["m"] * s["l"] * (sp.cos(s["th"]) - sp.cos(s["x"]) * sp.sin(s["th"]))
            + s["thdd"] * s["m"] * s["l"] ** 2
            + s["xd"] ** 2 * s["m"] * s["l"] * sp.sin(s["th"])
            + s["m"] * s["g"] * s["l"] * sp.sin(s["th"])
        ),
    )


def _x_row() -> tuple[bool, str]:
    return _row_difference(
        "row_x",
        lambda s: (
            s["xdd"] * (s["M"] + s["m"]) * (1 + sp.cos(s["x"]) ** 2)
            + s["thdd"] * s["m"] * s["l"] * (sp.cos(s["th"]) - sp.cos(s["x"]) * sp.sin(s["th"]))
            - s["xd"] ** 2 * (s["M"] + s["m"]) * sp.sin(s["x"]) * sp.cos(s["x"])
            - (s["M"] + s["m"]) * s["g"] * sp.cos(s["x"])
        ),
    )


def _v22() -> tuple[bool, str]:
    s = lagrange()
    derived = sp.expand(s["row_x"]).coeff(s["thd"], 2)
    printed = -s["m"] * s["l"] * (sp.sin(s["th"]) + sp.cos(s["th"])) * sp.cos(s["x"])
    left = sp.simplify(printed - derived)
    return left != 0, (
        f"$θ̇²$ in the $x$ row is {mathematics(sp.factor(derived))}; "
        f"printed minus derived = {mathematics(left)}"
    )


def _mass_matrix() -> tuple[bool, str]:
    s = lagrange()
    derived = [  # the equations of x and of θ
        [sp.expand(s[row]).coeff(s[a]) for a in ("xdd", "thdd")] for row in ("row_x", "row_th")
    ]
    coupling = s["m"] * s["l"] * (sp.cos(s["th"]) - sp.cos(s["x"]) * sp.sin(s["th"]))
    inertia = (s["M"] + s["m"]) * (1 + sp.cos(s["x"]) ** 2)
    printed = sp.Matrix([[coupling, s["m"] * s["l"] ** 2], [inertia, coupling]])
    equal = (printed - sp.Matrix(derived[::-1])).expand() == sp.zeros(2)
    numbers = {s["M"]: 2, s["m"]: sp.Rational(1, 2), s["l"]: 1}
    determinant = sp.lambdify((s["x"], s["th"]), printed.det().subs(numbers))
    angles = np.linspace(-pi, pi, 181)
    largest = float(np.max(determinant(*np.meshgrid(angles, angles))))
    return equal and largest < 0.0 and printed[0, 1] != printed[1, 0], (
        "the printed rows are those of $θ$ and of $x$, in the order of $U = [τ; 0]$: the same two equations. "
        f"$M$ is then not symmetric, entries (1,2) = {mathematics(printed[0, 1])} and (2,1) = "
        f"{mathematics(printed[1, 0])}, and its determinant at most {largest:.4g} over all $x$ and $θ$ "
        "(181 × 181 points): it can be inverted all the same"
    )


def _gravity() -> tuple[bool, str]:
    s = lagrange()
    still = {s[n]: 0 for n in ("xd", "thd", "xdd", "thdd")}
    derived = [sp.simplify(s[name].subs(still)) for name in ("row_th", "row_x")]
    printed = [
        s["m"] * s["g"] * s["l"] * sp.sin(s["th"]),
        -(s["M"] + s["m"]) * s["g"] * sp.cos(s["x"]),
    ]
    turned = all(sp.simplify(a + b) == 0 for a, b in zip(derived, printed, strict=True))
    lean = 0.01
    falls = passive(PlantState(pi / 2, lean, 0.0, 0.0), 0.0, 0.0, Body())[1]
    rises = as_printed(PlantState(pi / 2, lean, 0.0, 0.0), 0.0, 0.0, Body())[1]
    return turned and falls > 0.0 > rises, (
        f"derived $G$ = {mathematics(derived)}, the printed one is its negative; leaning by {lean:g} rad "
        f"the trunk accelerates by {falls:+.4f} rad/s² (it falls), as printed by {rises:+.4f} (it rises "
        "by itself)"
    )


def _equation_12() -> tuple[bool, str]:
    """Return how far off eq. 12's signs are once M, V and G themselves are right."""
    s = lagrange()
    rows = [sp.expand(s["row_x"]), sp.expand(s["row_th"])]
    still = {s["xd"]: 0, s["thd"]: 0, s["xdd"]: 0, s["thdd"]: 0}
    mass = sp.Matrix([[r.coeff(a) for a in (s["xdd"], s["thdd"])] for r in rows])
    gravity = sp.Matrix([r.subs(still) for r in rows])
    moving = sp.Matrix([r.subs({s["xdd"]: 0, s["thdd"]: 0}) for r in rows]) - gravity
    values = {s["M"]: 2, s["m"]: 0.5, s["l"]: 1, s["g"]: 9.81}
    parts = sp.lambdify(
        [s[n] for n in ("x", "th", "xd", "thd")],
        [part.subs(values) for part in (mass, moving, gravity)],
    )
    rng = np.random.default_rng(1)
    right = wrong = 0.0
    for _ in range(200):
        x, theta, x_dot, theta_dot = rng.uniform(-2.0, 2.0, 4).tolist()
        a, v, g = (np.asarray(part, dtype=float) for part in parts(x, theta, x_dot, theta_dot))
        u = np.array([[0.0], [3.0]])
        truth = np.array(passive(PlantState(x, theta, x_dot, theta_dot), 0.0, 3.0, Body()))
        right = max(right, float(np.max(np.abs(np.linalg.solve(a, u - v - g)[:, 0] - truth))))
        wrong = max(wrong, float(np.max(np.abs(np.linalg.solve(a, v - g - u)[:, 0] - truth))))
    return right < 1e-9 < wrong, (
        f"with the right $M$, $V$, $G$ at 200 random states: $−M⁻¹V − M⁻¹G + M⁻¹U$ is the plant to "
        f"{right:.1e}, the printed $+M⁻¹V − M⁻¹G − M⁻¹U$ is off by up to {wrong:.3g} (SI)"
    )


def _negative_gains() -> tuple[bool, str]:
    lin = linearise(TrunkSimulator())

    def fastest(gain: float) -> float:
        return float(np.max(np.roots([1.0, 0.0, lin.b * gain - lin.a]).real))

    down, up = fastest(-KU), fastest(KU)
    return down > 0.0 and up < 1e-9, (
        f"poles of the linearised trunk with $u = K (r − θ)$: $K = −100$ has one at {down:+.2f} 1/s, "
        f"$K = +100$ none right of {up:.1g}"
    )


def _gain_conversion() -> tuple[bool, str]:
    kp, ti, td = 0.6 * KU, TU / 2.0, TU / 8.0
    printed, right = (kp * ti, kp / td), (kp / ti, kp * td)
    return np.allclose(printed, (36.0, 400.0)) and not np.allclose(right, printed), (
        f"$K_p·T_i = {printed[0]:g}$ and $K_p/T_d = {printed[1]:g}$ give the printed numbers; by eq. 13 "
        f"$K_i = K_p/T_i = {right[0]:g}$, $K_d = K_p·T_d = {right[1]:g}$"
    )


def _range() -> tuple[bool, str]:
    low, printed, right = 0.32 * KU, 0.06 * KU, 0.6 * KU
    return (
        printed < low < right,
        f"$K_{{p,min}} = {low:g}$; $0.06 K_u = {printed:g}$ lies below it, $0.6 K_u = {right:g}$",
    )


def single_repairs(table: tuple[str, ...]) -> list[tuple[int, int]]:
    """Return the single cells whose change makes a table of S and B symmetric in e and in ė."""
    cells = [row.split() for row in table]

    def symmetric() -> bool:
        return cells == cells[::-1] and all(row == row[::-1] for row in cells)

    repairs = []
    for i, row in enumerate(cells):
        for j, label in enumerate(row):
            row[j] = "B" if label == "S" else "S"
            if symmetric():
                repairs.append((i, j))
            row[j] = label
    return repairs


def _table_3() -> tuple[bool, str]:
    repairs = single_repairs(KD_AS_PRINTED)
    names = ", ".join(f"({INPUT_LABELS[i]}, {INPUT_LABELS[j]})" for i, j in repairs)
    return [(INPUT_LABELS[i], INPUT_LABELS[j]) for i, j in repairs] == [("NM", "PB")], (
        f"of the 49 cells, changing one alone restores both symmetries ($e → −e$, $ė → −ė$): {names}"
    )


def _pulse() -> tuple[bool, str]:
    lean = np.radians(100.0)
    return lean > pi / 2.0, (
        f"100° = {lean:.4f} rad is an angle: it can be added to the measured angle of the trunk, "
        "but not to a hip that has a position in m and a force in N; the channel is configurable"
    )


def _no_ultimate_gain() -> tuple[bool, str]:
    lin = linearise(TrunkSimulator())
    weight = lin.a / lin.b
    gains = np.geomspace(1.02 * weight, 1e4, 60)
    real = max(float(np.max(np.abs(np.roots([1.0, 0.0, lin.b * k - lin.a]).real))) for k in gains)
    period = 2.0 * pi / sqrt(lin.b * KU - lin.a)
    wanted = ((2.0 * pi / TU) ** 2 + lin.a) / lin.b
    plant = TrunkSimulator(update_rate=1000.0)
    late = min(
        loop_of(plant, PidConfig(update_rate=1000.0, p=float(k), i=0.0, d=0.0)).radius()
        for k in gains
    )
    return real < 1e-6 and abs(period - TU) > 0.1 and late > 1.0, (
        f"pure P, 60 gains from $1.02·m g l = {gains[0]:.3g}$ to 1e4: largest |real part| of a pole "
        f"{real:.1g} 1/s: every one oscillates for ever, none is the ultimate one; at $K = 100$ the period "
        f"is {period:.3f} s, not 1.2 s (that takes $K = {wanted:.3g}$); sampled at 1 kHz every one grows "
        f"(smallest spectral radius {late:.9f})"
    )


ERRATA = (
    Erratum("(1)", "generalized momentum $Q$", "generalized force", _force),
    Erratum(
        "(10), τ row",
        "$ẋ m l (…)$, $ẋ² m l sin θ$, $+m g l sin θ$",
        "$ẍ m l (…)$, $ẋ² m l sin x sin θ$, $−m g l sin θ$",
        _torque_row,
    ),
    Erratum(
        "(10), x row",
        "no $θ̇²$ term; $−(M + m) g cos x$",
        "$−m l (sin θ + cos x cos θ) θ̇²$; $+(M + m) g cos x$",
        _x_row,
    ),
    Erratum(
        "under (11), V22",
        "$−m l (sin θ + cos θ) cos x θ̇$",
        "$−m l (sin θ + cos x cos θ) θ̇$",
        _v22,
    ),
    Erratum(
        "under (11), M",
        "rows in the order $(θ, x)$ against $Z = [x, θ]$",
        "unconventional, not a misprint, as $U = [τ; 0]$; with rows swapped it is symmetric",
        _mass_matrix,
    ),
    Erratum("under (11), G", "both signs: gravity points up", "both reversed", _gravity),
    Erratum("(12)", "$Ż = …$, $+M⁻¹V$, $−M⁻¹U$", "$[Ż; Z̈] = …$, $−M⁻¹V$, $+M⁻¹U$", _equation_12),
    Erratum("gains", "$K_u = −100$, $K_p = −60$ …", "positive for $e = r − θ$", _negative_gains),
    Erratum("kd, ki", "$−400$, $−36$", "$−9$, $−100$ by Table 1 and eq. 13", _gain_conversion),
    Erratum("(16)", "$K_{p,max} = 0.06 K_u$", "$0.6 K_u$", _range),
    Erratum("Table 3", "(NM, PB) = S", "B", _table_3),
    Erratum("§IV, §V", "pulses “of 100 degrees” / “on the hip”", "contradictory", _pulse),
    Erratum("Ku, Tu", "$−100$, 1.2 s", "there is no ultimate gain", _no_ultimate_gain),
)
