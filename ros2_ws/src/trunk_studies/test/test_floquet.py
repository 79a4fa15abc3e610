"""Floquet multipliers against the loop itself, and against matrices worked out by hand."""

import numpy as np
import pytest

from trunk_runs.plan import RunPlan, make_plan
from trunk_studies.batch.compiled_run import run_compiled
from trunk_studies.tuning.floquet import floquet

WALK = [
    "simulator.hip.mode=prescribed",
    "simulator.path.amplitude=0.05",
    "simulator.path.wavenumber=9.0",
    "simulator.initial.velocity=[1.2, 0.0]",
    "simulator.initial.position=[0.0, 1.0e-15]",
    "simulator.substeps=1",
]


def plan(controller: str, *settings: str, rate: float = 500.0) -> RunPlan:
    return make_plan(
        "fig6",
        controller,
        ["profile_practical"],
        [*WALK, *settings],
        {"update_rate": rate, "duration": 12.0},
    )


CASES = {
    "pid, delayed, unstable": ("pid", ["simulator.sensor.delay=0.08"]),
    "pid, delayed, stable": ("pid", ["simulator.sensor.delay=0.04", "pid.gains.i=20.0"]),
    "pid, filtered, slower": (
        "pid",
        ["pid.derivative_filter_time=0.02", "pid.update_rate=100", "pid.derivative_mode=error"],
    ),
    "pid, on harmonics": (
        "pid",
        [
            "simulator.sensor.delay=0.04",
            "pid.gains.i=20.0",
            "simulator.path.amplitude=0.0",
            "simulator.path.wavenumber=4.5",
            "simulator.path.cosines=[0.01, 0.03]",
            "simulator.path.sines=[0.0, 0.02, 0.005]",
        ],
    ),
    "fuzzy_pid, delayed": ("fuzzy_pid", ["simulator.sensor.delay=0.045"]),
    "pid, by a real drive": (
        "pid",
        ["simulator.actuator.time_constant=0.08", "simulator.actuator.viscous_friction=0.1"],
    ),
}


LONG = (
    "pid, on harmonics",
    "pid, delayed, stable",
    "pid, delayed, unstable",
    "pid, filtered, slower",
    "fuzzy_pid, delayed",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "settings"),
    [
        pytest.param(*case, id=name, marks=[pytest.mark.one_in(8)] * (name in LONG))
        for name, case in CASES.items()
    ],
)
def test_small_errors_grow_as_the_multipliers_say(controller, settings):
    made = plan(controller, *settings)
    table = run_compiled(made).table
    log_size = np.log(np.hypot(table.theta, table.theta_dot / 20.0))
    window = int(0.4 * made.simulator.update_rate)  # s: longer than half an oscillation
    peaks = log_size[: len(log_size) // window * window].reshape(-1, window).max(axis=1)
    small = (peaks > np.log(1e-30)) & (peaks < np.log(1e-3))
    last = len(peaks) if small.all() else int(np.argmin(small))
    assert last > 6
    seen = float(np.polyfit(0.4 * np.arange(2, last), peaks[2:last], 1)[0])
    assert seen == pytest.approx(np.log(floquet(made).growth), rel=0.05)


@pytest.mark.slow
def test_without_a_loop_the_trunk_falls_at_its_own_rate():
    gains = [f"pid.gains.{gain}=0.0" for gain in "pid"]
    made = plan("pid", *gains, "simulator.path.amplitude=0.0", rate=1000.0)
    assert np.log(floquet(made).growth) == pytest.approx(np.sqrt(9.81), rel=1e-6)


def test_a_sampled_pd_loop_by_hand():
    kp, kd, h, inertia = 60.0, 9.0, 0.002, 0.5
    settings = ["pid.gains.p=60.0", "pid.gains.i=0.0", "pid.gains.d=9.0"]
    made = plan("pid", *settings, "simulator.path.amplitude=0.0", "simulator.plant.gravity=0.0")
    by_hand = np.array(
        [
            [1.0 - 0.5 * h * h * kp / inertia, h - 0.5 * h * h * kd / inertia],
            [-h * kp / inertia, 1.0 - h * kd / inertia],
        ]
    )
    expected = np.max(np.abs(np.linalg.eigvals(by_hand)))
    # The integral is summed although its gain is 0: its multiplier 1 moves nothing, and is left out.
    assert floquet(made).radius == pytest.approx(expected, rel=1e-6)
