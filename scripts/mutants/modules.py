"""Which modules are mutated, and the quick tests of each: the quickest first, a failure ends it."""

from __future__ import annotations

from typing import NamedTuple

UTIL = "ros2_ws/src/trunk_msgs_util/"
SIM = "ros2_ws/src/trunk_sim/"
CONTROL = "ros2_ws/src/trunk_control/"
EXPERIMENTS = "ros2_ws/src/trunk_experiments/"


class Module(NamedTuple):
    """A module's file, and the arguments of pytest, both from the root of the tree.

    ``placeholders``: constants that stand where nothing is read, so that no test could tell their values.
    """

    file: str
    tests: tuple[str, ...]
    placeholders: tuple[str, ...] = ()


def _in(folder: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{folder}test/test_{name}.py" for name in names)


_PID = (
    *_in(CONTROL, "pid", "pid_reconfigure", "pid_antiwindup", "extreme_numbers", "pid_loop"),
    *("-k", "not every_command"),  # a minute, over four laws
)
_REFUSALS = "tests/test_refusals.py::test_by_its_class"
_LOOP = (*_in(EXPERIMENTS, "compiled_run"), "tests/test_turns.py", "tests/same_bits")
_VERIFY = ("tests/verify", "tests/test_turns.py", "-k", "not compiled")

MODULES = {
    "mechanics": Module(
        UTIL + "trunk_msgs_util/mechanics.py",
        (
            "tests/test_inverse_dynamics.py",
            *_in(UTIL, "mechanics"),
            *_in(SIM, "plant"),
        ),
    ),
    "plant": Module(SIM + "trunk_sim/plant.py", _in(SIM, "plant_as_printed", "plant")),
    "step": Module(SIM + "trunk_sim/step.py", _in(SIM, "step", "simulation")),
    "pacing": Module(
        SIM + "trunk_sim/pacing.py",
        _in(SIM, "pacing_real_time", "pacing_lockstep", "pacing_config"),
    ),
    **{
        name: Module(CONTROL + f"trunk_control/{name}.py", _PID)
        for name in ("limits", "pid", "pid_family")
    },
    "fuzzy": Module(CONTROL + "trunk_control/fuzzy.py", (*_in(CONTROL, "fuzzy"), "-k", "not grid")),
    "fuzzy_pid": Module(CONTROL + "trunk_control/fuzzy_pid.py", _in(CONTROL, "fuzzy_pid")),
    "fuzzy_torque": Module(CONTROL + "trunk_control/fuzzy_torque.py", _in(CONTROL, "fuzzy_torque")),
    "rule_tables": Module(
        CONTROL + "trunk_control/rule_tables.py",
        (*_in(CONTROL, "rule_tables", "config"), _REFUSALS),
    ),
    "rule_base": Module(
        CONTROL + "trunk_control/rule_base.py",
        (*_in(CONTROL, "config", "rule_tables", "fuzzy_pid"), _REFUSALS),
    ),
    "decide": Module(
        CONTROL + "trunk_control/decide.py",
        _in(CONTROL, "controller", "bumpless_transfer"),
        placeholders=("_SAMPLE", "_NO_TRANSFER"),
    ),
    "reference": Module(
        CONTROL + "trunk_control/reference.py", (*_in(CONTROL, "reference"), _REFUSALS)
    ),
    "metrics": Module(
        EXPERIMENTS + "trunk_experiments/analysis/metrics.py", ("tests/test_metrics.py",)
    ),
    "loop": Module(EXPERIMENTS + "trunk_experiments/runs/loop.py", _LOOP),
    "loop_schedule": Module(EXPERIMENTS + "trunk_experiments/runs/schedule.py", _LOOP),
    "engine": Module(EXPERIMENTS + "trunk_experiments/runs/engine.py", _LOOP),
    **{
        name: Module(EXPERIMENTS + f"trunk_experiments/replay/{name}.py", _VERIFY)
        for name in ("rerun", "in_force")
    },
}
