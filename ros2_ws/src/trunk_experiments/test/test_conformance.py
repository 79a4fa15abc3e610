"""The conformance kit finds each planted fault by its own check, and nothing in an honest law."""

import sys
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from itertools import product
from types import ModuleType
from typing import NamedTuple

import pytest

from trunk_control.law import Law
from trunk_control.laws import law_named
from trunk_experiments.conformance.kit import Check
from trunk_experiments.conformance.law import CHECKS, CONTRACT, conformance
from trunk_experiments.conformance.purity import problems
from trunk_runs.nodes import CONTROLLERS
from trunk_studies.batch import compiled_run

from ...trunk_control.test.faulty_laws import FAULTS, HONEST, Memory

BY_NAME = {check.name: check for check in CHECKS}
# These need a registered name; tests/graph/test_pages.py has them.
ALONE = [check for check in CHECKS if check.name not in ("compiled", "lanes", "replay")]


COMPILED_LONG = {("compiled", name) for name in CONTROLLERS if name != "computed_torque"}


@pytest.mark.parametrize(("check", "law"), FAULTS.values(), ids=FAULTS)
def test_a_planted_fault_is_found_by_its_own_check(check: str, law: Law) -> None:
    found = [one for one in BY_NAME[check].run(law) if not one.note]
    assert found
    for one in found:
        assert one.check == check
        assert one.function
        assert one.problem
        assert one.advice


@pytest.mark.parametrize("check", ALONE, ids=lambda check: check.name)
def test_an_honest_law_passes_every_check(check: Check[Law]) -> None:
    assert [one for one in check.run(HONEST) if not one.note] == []


class Counting(NamedTuple):
    effort: float = 0.0
    count: int = 0


class Window(NamedTuple):
    effort: float = 0.0
    past: tuple[float, list[float]] = (0.0, [1.0])


class Inner(NamedTuple):
    integral: float = 0.0
    counts: tuple[int, bool] = (0, False)


class Nested(NamedTuple):
    effort: float = 0.0
    inner: Inner = Inner()


@pytest.mark.parametrize(
    ("inner", "problem"),
    [
        (Inner(1), "memory.inner.integral = 1 is int"),
        (Inner(counts=(0, 1)), "memory.inner.counts.1 = 1 is int"),
        (Inner(counts=(0, False, 0)), "memory.inner.counts = (0, False, 0) has 3 parts"),
        ((0.0, (0, False)), "memory.inner = (0.0, (0, False)) is tuple"),
        (Inner(0.0, (1, True)), None),
    ],
)
def test_every_leaf_of_a_memory_has_the_declared_type(inner: object, problem: str | None) -> None:
    def update(memory, sample, constants, limits):
        after, terms = HONEST.update(Memory(), sample, constants, limits)
        return Nested(after.effort, inner), terms

    found = BY_NAME["types"].run(replace(HONEST, update=update, memory=Nested()))
    assert [one.problem for one in found] == ([problem] if problem else [])


@pytest.mark.parametrize("check", ["lanes", "linear"])
def test_a_memory_of_other_than_numbers_is_noted_by_name(check: str) -> None:
    (note,) = BY_NAME[check].run(replace(HONEST, memory=Window()))
    assert note.note
    assert "memory.past.1 is [1.0]" in note.problem


def test_a_memory_that_counts_at_rest_has_no_linear_model() -> None:
    def count(memory, sample, constants, limits):
        after, terms = HONEST.update(Memory(0.0, memory.effort), sample, constants, limits)
        return Counting(after.effort, memory.count + 1), terms

    counting = replace(HONEST, update=count, memory=Counting())
    (note,) = BY_NAME["linear"].run(counting)
    assert "whole numbers or flags in its memory change from update to update" in note.problem


def test_what_numba_refuses_is_noted(command_says, monkeypatch):
    def refused(loop, tell):
        tell("no dict")
        return loop

    monkeypatch.setattr(compiled_run, "compiled_or_plain", refused)
    monkeypatch.setattr(compiled_run, "compiled_loop", compiled_run.compiled_loop.__wrapped__)
    code, out, _ = command_says("controller", "check", "pid")
    assert code == 0
    (note,) = [line for line in out.splitlines() if line.startswith("note: compiled")]
    assert "not compilable: no dict" in note
    assert "sweeps will use CPython, " in note
    assert "19 of 20 kept, 1 noted\n" in out
    assert [line.split()[1] for line in out.splitlines() if line.startswith("  compiled ")] == [
        "noted"
    ]


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "check"),
    [
        pytest.param(
            name,
            check,
            id=f"{name}-{check.name}",
            # Compiling takes ten seconds for each law.
            marks=pytest.mark.one_in(8) if (check.name, name) in COMPILED_LONG else (),
        )
        for name, check in product(CONTROLLERS, CHECKS)
    ],
)
def test_the_shipped_laws_pass_every_check(name: str, check: Check[Law]) -> None:
    assert conformance(name, [check]) == []


def test_a_finding_names_function_input_and_advice() -> None:
    _, law = FAULTS["divides_by_dt"]
    (found,) = BY_NAME["finite"].run(law)
    assert found.line().endswith(
        "raises ZeroDivisionError: float division by zero: test `usable` first, and hold"
    )
    assert (
        "faulty_laws.divides_by_dt: reference 0.0, measurement 0.0, rate 0.0, dt 0.0"
        in found.line()
    )


def test_where_a_sine_is_nan_is_said() -> None:
    (found,) = BY_NAME["finite"].run(FAULTS["compensates_by_a_sine"][1])
    assert "sin and cos of trunk_control.api are NaN beyond +-1647099 rad" in found.advice
    assert all("NaN" not in one.advice for one in BY_NAME["finite"].run(FAULTS["divides_by_dt"][1]))


def test_the_shipped_law_of_the_fuzzy_pid_has_its_own_names() -> None:
    assert law_named("fuzzy_pid").record_names[:3] == ("reference", "measurement", "error")


@pytest.mark.parametrize(
    ("power", "instead"),
    [
        ("x**2", "write (x) * (x)"),
        ("(x / y)**3", "write (x / y) * (x / y) * (x / y)"),
        ("x**4.0", "write (x) * (x) * (x) * (x)"),
        ("x**2.5", "use exp and log"),
        ("x**-1", "use exp and log"),
        ("x**y", "use exp and log"),
        ("2.0**y", "use exp and log"),
        ("1.1**3", "write 1.1 * 1.1 * 1.1"),
        ("2**10", None),  # whole numbers are exact
        ("3**0", None),
    ],
)
def test_a_power_is_refused_with_what_to_write(tmp_path, power: str, instead: str | None) -> None:
    (tmp_path / "powers.py").write_text(
        f"def update(x, y):\n    return {power}\n\n\ndef into(x, y):\n    x **= y\n    return x\n"
    )
    source = spec_from_file_location("powers", tmp_path / "powers.py")
    module = module_from_spec(source)
    source.loader.exec_module(module)
    found = list(problems(module.update, CONTRACT))
    assert [instead in str(one) for one in found] == ([] if instead is None else [True])
    assert all(one.check == "portable" for one in found)
    assert "x **= y" in str(list(problems(module.into, CONTRACT)))


@pytest.fixture
def default_file(tmp_path, monkeypatch):
    """Return where the package of the honest law has its default file; it is imported by colcon's link."""
    (tmp_path / "build").symlink_to(tmp_path)
    package = ModuleType("package_of_honest")
    package.__file__ = str(tmp_path / "build" / "__init__.py")
    monkeypatch.setitem(sys.modules, "package_of_honest", package)
    monkeypatch.setattr(HONEST.config, "__module__", "package_of_honest.law")
    (tmp_path / "config").mkdir()
    return tmp_path / "config" / "default.yaml"


DEFAULTS = "/**/honest:\n  ros__parameters:\n    "


@pytest.mark.parametrize(
    ("values", "problems"),
    [
        ("{update_rate: 200.0, gain: 40.0}", {}),
        ("{gain: 41.0}", {"has gain: 41.0, the law's default is 40.0": True}),
        (
            "{gains: 40.0}",
            {
                "sets gains, which the law does not declare": False,
                "lacks gain, default 40.0": False,
            },
        ),
    ],
    ids=["same", "value", "renamed"],
)
def test_a_default_file_that_went_stale_is_found(default_file, values, problems):
    default_file.write_text(f"{DEFAULTS}{values}\n")
    findings = list(BY_NAME["defaults"].run(HONEST))
    assert {finding.problem: finding.note for finding in findings} == problems
    assert {finding.function for finding in findings} <= {str(default_file)}


def test_a_default_file_that_cannot_be_read_is_found(default_file):
    default_file.write_text("{")
    assert [finding.note for finding in BY_NAME["defaults"].run(HONEST)] == [False]
