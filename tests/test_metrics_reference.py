"""The metrics of the reference runs, simulated by the packages' pure functions."""

from math import inf, pi

import numpy as np
import pytest

from trunk_control.controller import Controller
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.pid import PidConfig
from trunk_core.samples import JointSample
from trunk_evidence.run_table import RunTable, metrics
from trunk_sim.config import TrunkSimulator
from trunk_sim.disturbances import Disturbance
from trunk_sim.simulation import Simulation

PAPER = {
    "update_rate": 1000.0,
    "derivative_mode": "error",
    "u_clamp_max": inf,
    "u_clamp_min": -inf,
    "antiwindup_strategy": "none",
}
STEP = {"reference_profile": "step", "reference_value": pi / 4.0}


def pid(p=60.0, i=100.0, d=9.0, **options):
    return Controller(PidConfig(p=p, i=i, d=d, **PAPER, **options))


def fuzzy_pid(**options):
    return Controller(FuzzyPidConfig(**PAPER, **options))


def run(controller, steps=10_000) -> RunTable:
    plant = Simulation(TrunkSimulator(update_rate=1000.0, substeps=10))
    rows = []
    for _ in range(steps + 1):
        truth: JointSample = plant.truth()
        answer = controller.update(truth.stamp_ns, truth.position[1], truth.velocity[1])
        rows.append((truth.stamp_ns / 1e9, truth.position[1], answer.reference, answer.effort))
        plant.step(answer.effort, Disturbance())
    t, theta, reference, torque = np.array(rows).T
    unused = dict.fromkeys(RunTable.__dataclass_fields__, np.full(t.shape, np.nan))
    return RunTable(**{**unused, "t": t, "theta": theta, "reference": reference, "torque": torque})


# As printed: overshoot, settling, steady state (mean, RMS), IAE, ISE, ITAE, effort, peak, range.
REFERENCE = {
    "fig6 pid as_printed": (
        lambda: pid(60.0, 36.0, 400.0),
        "16.222 - 15.781 15.785 2.35353 .71964 10.5043 111.81 31.435 -16.222 30",
    ),
    "fig6 pid ziegler_nichols": (
        pid,
        "6.6953 1.385 -1.0282 2.4776 .46310 .05308 1.88821 145.28 31.468 -6.695 30",
    ),
    "fig6 fuzzy_pid": (
        fuzzy_pid,
        "9.3731 1.843 -.2794 2.7843 .63947 .07939 2.42780 126.33 31.514 -9.373 30",
    ),
    "fig7 pid ziegler_nichols": (
        lambda: pid(**STEP),
        "9.5521 - .0071 3.4594 .60717 .08354 2.48723 51332.9 7118.2 -6.695 54.552",
    ),
    "fig7 fuzzy_pid": (
        lambda: fuzzy_pid(**STEP),
        "8.6754 1.066 .4719 3.1490 .66250 .09693 2.39190 204668.6 14162.4 -9.373 53.675",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCE)
def test_reference_numbers(name):
    controller, expected = REFERENCE[name]
    found = metrics(run(controller())).as_dict()
    for (key, value), printed in zip(found.items(), expected.split(), strict=True):
        if printed == "-":
            assert value == inf, key  # it never settles
        else:
            half_a_digit = 0.5 * 10.0 ** -len(printed.partition(".")[2])
            assert value == pytest.approx(float(printed), rel=1e-4, abs=half_a_digit), key
