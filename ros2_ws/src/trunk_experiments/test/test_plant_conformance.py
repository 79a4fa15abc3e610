"""The conformance kit of plants finds each planted fault by its own check, and nothing in an honest plant."""

from dataclasses import replace
from itertools import product

import pytest

from trunk_experiments.conformance import plant as kit
from trunk_experiments.conformance.kit import Check
from trunk_experiments.conformance.plant import CHECKS, KIT, conformance
from trunk_sim.plant import PLANTS, Plant

from ...trunk_core.test.c_programs import COMPILER, needs_compiler
from ...trunk_sim.test.faulty_plants import FAULTS, HONEST, LOSSY, WITHOUT_ENERGY

BY_NAME = {check.name: check for check in CHECKS}


@pytest.mark.parametrize(("check", "plant"), FAULTS.values(), ids=FAULTS)
def test_a_planted_fault_is_found_by_its_own_check(check: str, plant: Plant) -> None:
    findings = [finding for finding in BY_NAME[check].run(plant) if not finding.note]
    assert findings
    for finding in findings:
        assert finding.check == check
        assert finding.function
        assert finding.problem
        assert finding.advice


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "check"),
    [
        # Compiling takes ten seconds for each plant.
        pytest.param(
            name,
            check,
            id=f"{name}-{check.name}",
            marks=pytest.mark.one_in(8) if check.name == "compiled" else (),
        )
        for name, check in product(("trunk", "cart_pole"), CHECKS)
    ],
)
def test_the_shipped_plants_pass_every_check(name: str, check: Check[Plant]) -> None:
    assert conformance(name, [check]) == []


def test_the_cart_pole_gives_nothing_to_note_without_runs():
    runs = ("compiled", "lanes", "exportable", "replay")
    checks = [check for check in CHECKS if check.name not in runs]
    assert [finding for check in checks for finding in KIT.findings_of("cart_pole", check)] == []


def test_what_one_drive_cannot_hold_is_noted():
    (note,) = BY_NAME["linear"].run(PLANTS.named("trunk"))  # nothing pushes it along level ground
    assert note.note
    assert "does not control both coordinates" in note.problem


@pytest.mark.parametrize(
    ("plant", "said"),
    [(LOSSY, "if that is friction"), (WITHOUT_ENERGY, "give Plant(energy=...)")],
)
def test_an_energy_that_is_lost_or_missing_is_noted(plant, said):
    (note,) = BY_NAME["energy"].run(plant)
    assert note.note
    assert said in note.advice


def test_a_plant_that_needs_shorter_steps_is_told(monkeypatch):
    short = replace(HONEST.config(), length=1e-3)
    monkeypatch.setattr(kit, "constants_of", lambda plant: short.constants)
    (note,) = BY_NAME["energy"].run(HONEST)
    assert note.note
    assert "simulator.substeps" in note.advice


def test_annotations_and_decorators_are_not_what_a_function_calls():
    (finding,) = BY_NAME["source"].run(FAULTS["remembers_calls"][1])
    assert "uses CALLS, a list that may change" in finding.problem


def test_an_exception_names_the_line():
    def raises(state, force, torque, constants):
        raise ValueError("no such state")

    broken = replace(KIT, named=lambda name: replace(HONEST, accelerations=raises))
    (finding,) = broken.findings_of("mine", BY_NAME["rest"])
    line = raises.__code__.co_firstlineno + 1
    assert finding.function.endswith(f"raises, line {line}")
    assert finding.problem == "raises ValueError: no such state"
    assert finding.advice == "a plant never raises"


@needs_compiler
def test_c_with_other_bits_is_found(monkeypatch):
    text = kit.c_text(HONEST, HONEST.config().constants)
    assert not list(BY_NAME["exportable"].run(HONEST))
    monkeypatch.setattr(kit, "c_text", lambda *_: text.replace("out[1] = ", "out[1] = -"))
    (finding,) = BY_NAME["exportable"].run(HONEST)
    assert not finding.note
    assert "in C, " in finding.problem


def test_what_is_not_translated_is_noted():
    def takes_the_keys(state, force, torque, constants):
        return float(len({"a": force})), torque

    (note,) = BY_NAME["exportable"].run(replace(HONEST, accelerations=takes_the_keys))
    assert note.note
    assert "trunk lab and --device cuda refuse it" in note.advice


@pytest.mark.parametrize("compiler", ["no-such-compiler -m64", "false"])
def test_c_that_is_not_compiled_is_noted(monkeypatch, compiler):
    monkeypatch.setenv("CC", compiler)
    (note,) = BY_NAME["exportable"].run(HONEST)
    assert note.note
    assert "its C was not compared with CPython" in note.problem


@needs_compiler
def test_a_compiler_may_have_options(monkeypatch):
    monkeypatch.setenv("CC", f"{COMPILER} -O1")
    assert not list(BY_NAME["exportable"].run(HONEST))


def test_the_gains_of_a_heavy_plants_run_are_within_their_bounds():
    heavy = replace(HONEST.config(), cart_mass=1e9)
    assert kit.short_plan(replace(HONEST, level=lambda constants: heavy.constants))
