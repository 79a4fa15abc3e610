"""One plan by every path, from compiled code to a kernel: the bits of CPython."""

import re
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, content, copied
from ros2_ws.src.trunk_runs.test.random_plans import random_plan
from ros2_ws.src.trunk_studies.test import cpp_device

from trunk_core import topics
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable
from trunk_recording.reader import Recording
from trunk_runs.plan import RunPlan

from ..finished import finished
from .paths import IN_ONE_PROCESS, difference, differences, reference
from .scenarios import SCENARIOS, random_links

PLANS: dict[str, Callable[[], RunPlan]] = {
    **{name: scenario.plan for name, scenario in SCENARIOS.items()},
    **{f"random {i}": partial(random_plan, i) for i in (3, 8, 14, 232)},
    **{f"random links {i}": partial(random_links, i, 5) for i in range(3)},
}
ONE_CALL = {"batch", "lanes", "kernel", "c"}
NOT_TAKEN = {
    **{name: {"lanes", "kernel"} for name in PLANS if "links" in name},
    **{name: {"lanes"} for name in ("random 3", "random 8")},
    "random 14": {"lanes", "kernel"},
    **{
        name: {"lanes", "kernel"} if scenario.swaps else {"lanes"}
        for name, scenario in SCENARIOS.items()
        if scenario.swaps or "simulator.fall.stop=true" in scenario.settings
    },
    "a sensor that always fails": {"lanes", "kernel"},
    **{name: ONE_CALL for name, one in SCENARIOS.items() if one.changes or one.references},
    "divergence": {"recorded", "like", "branch", "lanes"},
}
CELLS = [
    pytest.param(name, path, id=f"{path}: {name}")
    for path in IN_ONE_PROCESS
    for name in PLANS
    if path not in NOT_TAKEN.get(name, ())
]
NO_COMPILER = not (shutil.which("gcc") or shutil.which("clang"))


@pytest.mark.slow
@pytest.mark.one_in(4)
@pytest.mark.parametrize(("name", "path"), CELLS)
def test_every_path_has_the_bits_of_cpython(name: str, path: str, tmp_path: Path) -> None:
    if path == "c" and NO_COMPILER:
        pytest.skip("no C compiler: apt-get install gcc")
    if path == "kernel" and cpp_device.COMPILER is None:
        pytest.skip("no C++ compiler: apt-get install g++")
    plan = PLANS[name]()
    assert differences(path, plan, reference(plan, tmp_path), tmp_path) == []


@pytest.mark.slow
@pytest.mark.one_in(40)
@pytest.mark.parametrize("first", range(0, 200, 5))
def test_random_plans_have_the_bits_of_cpython_in_every_engine(first: int) -> None:
    able = {"compiled": True, "batch": True, "lanes": True, "kernel": cpp_device.COMPILER}
    able["c"] = not NO_COMPILER
    words = [f"--path={path}" for path, is_able in able.items() if is_able]
    command = [sys.executable, "-m", "tests.same_bits.check", "5", "--random", f"--seed={first}"]
    done = finished([*command, *words])
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("10 plans: 0 differ (")


def test_one_changed_bit_is_a_difference(tmp_path: Path) -> None:
    run = reference(SCENARIOS["fuzzy"].plan(), tmp_path)
    theta = RunTable.of_run(run).theta.copy()
    assert difference(run, {"theta": theta}) == []
    theta[7] *= 1.0 + 2.0**-52
    (line,) = difference(run, {"theta": theta})
    assert line.startswith("step 7: theta is ")
    assert difference(run, {"theta": theta[:-1]}) == ["1200 states, 1201 expected"]

    def flip(messages: list[list]) -> None:
        message = [one for one in messages if one[0] == "/effort_command"][70]
        message[2] = message[2][:-8] + bytes([message[2][-8] ^ 1]) + message[2][-7:]

    copied(run.path, tmp_path / "flipped.mcap", flip, ANEW)
    lines = difference(run, RecordedRun(Recording.open(tmp_path / "flipped.mcap")))
    assert lines[0].startswith("t = 0.07 s: effort_command: effort[trunk]: ")
    assert lines[-1].startswith("diverges: ")


# A letter for each topic; S: a controller's terms.
LETTERS = {
    **dict.fromkeys((f"/{topic}" for topic in topics.PICTURES), "V"),
    "/run/parameters": "P",
    "/run/events": "E",
    "/ground_truth/joint_states": "T",
    "/disturbance": "D",
    "/joint_states": "M",
    "/effort_command": "C",
}


@pytest.mark.parametrize("name", ["fuzzy", "pictures", "swaps", "a fall", "changes"])
def test_an_offline_recording_has_its_messages_in_the_order_of_the_loop(
    name: str, tmp_path: Path
) -> None:
    found, now = "", 0
    for topic, log_time, data, *_ in content(
        reference(SCENARIOS[name].plan(), tmp_path).path
    ).messages:
        letter = LETTERS.get(topic, "S")
        if letter in "EPT":  # the others may be ahead
            found += "<" * (log_time < now) + ">" * (log_time > now)
            now = log_time
        found += "F" if letter == "E" and b"fell" in data else letter
    state = "MCS?F?V*"
    assert re.fullmatch(f"P+E[EP]*TDD{state}([EP]*>TD{state})*E", found)


def test_a_path_that_makes_no_run_is_none(tmp_path: Path) -> None:
    plan = SCENARIOS["swaps"].plan()
    assert differences("lanes", plan, reference(plan, tmp_path), tmp_path) is None
