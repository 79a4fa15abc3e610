"""The compiled loop gives the bits of the offline run; its metrics are those of a recording."""

import os
import sys
import time
from collections import defaultdict
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numba
import numpy as np
import pytest

from trunk_control.laws import law_named
from trunk_core import compiled
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import declarations, values_of
from trunk_experiments.conformance.kit import first_difference
from trunk_runs import engine
from trunk_runs.engine import VELOCITY, states_of_run
from trunk_runs.loop import Schedule, check_compilable
from trunk_runs.nodes import NODES
from trunk_runs.plan import Swap, make_plan
from trunk_runs.timeline import Change
from trunk_sim.plants.trunk import passive
from trunk_sim.step import Dynamics, on_second, saturate
from trunk_studies.batch import compiled_run
from trunk_studies.batch.compiled_run import run_compiled, start_of_loop

from ...trunk_runs.test.random_plans import random_plan
from ...trunk_runs.test.stepwise import steps

# Names, and what decides how the graph waits and when nodes act (turns are drawn as swaps).
# The reference is for controllers in the graph that are not ours.
NOT_OFFLINE = ("recorder", "reference")
NOT_DRAWN = {
    *("joint", "joints", "wait_for", "controllers", "autostart", "plant.equations"),
    "gap.max_periods",  # younger than the runs that are frozen
}


@pytest.mark.slow
def test_every_parameter_is_drawn():
    plans = [random_plan(index) for index in range(400)]
    seen = defaultdict(set)
    for plan in plans:
        for node, config in plan.configs.items():
            if node not in NOT_OFFLINE:
                for name, value in values_of(config).items():
                    seen[node, name].add(value)
    names = {(node, n) for node, kind in NODES.items() for n in declarations(kind.config)}
    never = {key for key in names if len(seen[key]) < 2 and key[0] not in NOT_OFFLINE}
    assert {name for _, name in never} <= NOT_DRAWN
    assert any(len(plan.controllers) > 2 for plan in plans)
    assert any(plan.simulator.equations == "as_printed" for plan in plans)


def test_the_comparison_detects_one_changed_bit(monkeypatch):
    plan = make_plan("fig8", "pid", everywhere={"duration": 0.1})
    loop = compiled_run.compiled_loop(tuple(plan.controllers), plan.simulator.dynamics)

    def off(*given):
        result, out = loop(*given), given[-1]
        out[compiled_run.THETA, 7] *= 1.0 + 2.0**-52
        return result

    monkeypatch.setattr(compiled_run, "compiled_loop", lambda *given: off)
    assert "step 7: theta is" in first_difference(plan)


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_the_same_loop_runs_in_cpython():
    plan = make_plan("fig8", "pid", everywhere={"duration": 0.05}, swaps=[Swap(0.02, "lqr")])
    expected = run_compiled(plan).table
    out = np.empty((compiled_run.ROWS, len(expected.t)))
    laws = (law_named(name) for name in plan.controllers)
    loop = compiled_run.loop_of(*laws, dynamics=Dynamics(on_second, passive))
    start, noise = compiled_run.start_of_loop(plan), compiled_run._NO_NOISE
    assert loop(51, *start, noise, np.empty((1, 4)), Schedule(), out) == (51, False, False)
    assert out[compiled_run.THETA].tolist() == expected.theta.tolist()


def test_a_controller_at_half_the_plants_rate_answers_every_second_state():
    """Its periods fit by rounding: 2 * 1428571 ns are 1 ns less than 2857143 ns."""
    settings = ["pid.update_rate=350.0", "pid.derivative_mode=rate"]
    everywhere = {"duration": 0.05, "update_rate": 700.0}
    plan = make_plan("fig8", "pid", settings=settings, everywhere=everywhere)
    assert [step.answer.updated for step in steps(plan)] == [k % 2 == 0 for k in range(36)]


def test_what_a_compiled_loop_cannot_model_is_refused_by_name():
    plan = make_plan("fig6", "pid")
    with pytest.raises(PlanError, match="duration is 0"):
        run_compiled(replace(plan, simulator=replace(plan.simulator, duration=0.0)))
    with pytest.raises(PlanError, match=r"pid: reference\.profile is 'topic', but nobody"):
        run_compiled(plan.with_controller(replace(plan.controller, reference_profile="topic")))
    with pytest.raises(PlanError, match="simulator: parameters and turns that change by hand"):
        run_compiled(replace(plan, changes={"simulator": [Change(5, {"plant.length": 2.0})]}))
    with pytest.raises(PlanError, match=r"active\.times: no controller would act at t = 0 s"):
        run_compiled(plan.with_controller(replace(plan.controller, active_times=(1.0,))))


@pytest.mark.parametrize("compiled", [False, True])
def test_a_hip_that_is_prescribed_during_the_run_keeps_its_speed_from_then_on(compiled):
    """Other equations are another loop."""
    plan = make_plan("fig8", "pid", everywhere={"duration": 0.2})
    change = Change(99 * plan.simulator.period_ns, {"hip.mode": "prescribed"})
    plan = replace(plan, changes={"simulator": [change]})
    table = np.concatenate([states.table for states in states_of_run(plan, compiled)])
    speed = table[:, VELOCITY][:, 0]
    assert len(set(speed[:100])) == 100
    assert len(set(speed[100:])) == 1


def test_cpython_does_it_where_numba_is_missing(monkeypatch):
    plan = make_plan("fig7", "pid", everywhere={"duration": 0.2})
    for name in {"numba", *(name for name in sys.modules if name.startswith("numba."))}:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(engine, "worth_compiling", lambda *_: True)
    assert sum(len(states.table) for states in states_of_run(plan)) == 201
    with pytest.raises(ImportError):
        list(states_of_run(plan, compiled=True))


def test_short_runs_do_not_load_the_compiler():
    assert not engine.worth_compiling(
        make_plan("fig8", "pid", everywhere={"duration": 0.2}).simulator
    )
    assert engine.worth_compiling(make_plan("fig8", "pid", everywhere={"duration": 10.0}).simulator)


def loop_of(name, accelerations=passive):
    return compiled_run.loop_of(law_named(name), dynamics=Dynamics(on_second, accelerations))


def test_fingerprints_differ_by_law_and_are_stable():
    pid, fuzzy_pid = (loop_of(name) for name in ("pid", "fuzzy_pid"))
    assert compiled.fingerprint(pid) != compiled.fingerprint(fuzzy_pid)
    again = loop_of("pid")
    assert compiled.fingerprint(pid) == compiled.fingerprint(again)


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("from .settings import GAIN", "law/settings.py"),
        ("from . import settings", "law/settings.py"),
        ("from . import GAIN", "law/__init__.py"),
        ("from ..other.deep import (  # one\n    gain,\n    other as name,\n)", "other/deep.py"),
        ("def f():\n    from law_of_mine import \\\n        other", "other/__init__.py"),
        ("import json, law_of_mine.other.deep as deep", "other/deep.py"),
        ("import law_of_mine.other.deep", "other/__init__.py"),
        ("from trunk_control.law import Law", None),
    ],
)
def test_the_machine_code_is_of_all_that_its_sources_import(tmp_path, monkeypatch, text, path):
    package = tmp_path / "law_of_mine"
    for folder in (package, package / "law", package / "other"):
        folder.mkdir()
        (folder / "__init__.py").write_text("GAIN = 1.0\n")
    (package / "law/settings.py").write_text("GAIN = 1.0\n")
    (package / "other/deep.py").write_text("gain = other = 1.0\n")
    (package / "law/unused.py").write_text("")
    (package / "law/update.py").write_text(f"{text}\n\n\ndef update(x):\n    return x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    update = import_module(f"{package.name}.law.update").update

    def fingerprint() -> str:
        compiled._contents.cache_clear()
        compiled._meaning.cache_clear()
        return compiled.fingerprint(update)

    before = fingerprint()
    (package / "law/unused.py").write_text("OTHER = 1\n")
    assert fingerprint() == before
    if path is not None:
        (package / path).write_text("OTHER = 1\n")
        assert fingerprint() != before
    for name in [name for name in sys.modules if name.startswith("law_of_mine")]:
        del sys.modules[name]
    compiled._imported.cache_clear()


@pytest.mark.parametrize("name", ["trunk_sim/config", "trunk_control/law", "trunk_core/units"])
def test_the_machine_code_of_a_run_is_of_all_that_its_loop_imports(monkeypatch, name):
    loop = loop_of("pid")
    before = compiled.fingerprint(loop)
    meaning = compiled._meaning
    monkeypatch.setattr(
        compiled, "_meaning", lambda path: meaning(path) + b"#" * path.endswith(f"/{name}.py")
    )
    assert compiled.fingerprint(loop) != before


def test_it_compiles_even_without_a_writable_folder(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    twin = compiled.compiled(saturate)
    assert twin(3.0, 2.0) == 2.0


def test_it_compiles_even_without_a_home(monkeypatch):
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    assert compiled.compiled(saturate)(3.0, 2.0) == 2.0


def test_compiled_code_long_unused_is_deleted(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = tmp_path / "trunk"
    for name, days in (("0" * 16, 91), ("1" * 16, 89), ("somebody's", 91)):
        (kept / name).mkdir(parents=True)
        (kept / name / "code.nbc").touch()
        os.utime(kept / name, (time.time() - days * 86400,) * 2)
    compiled.compiled(saturate)
    assert {one.name for one in kept.iterdir()} == {
        *("1" * 16, "somebody's", compiled.fingerprint(saturate))
    }


def test_compiled_code_in_use_is_not_old(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiled.compiled(saturate)
    (kept,) = (tmp_path / "trunk").iterdir()
    os.utime(kept, (0, 0))
    compiled.compiled(saturate)
    assert kept.stat().st_mtime > time.time() - 3600


def test_a_law_has_one_compiled_loop_whatever_surrounds_it():
    """Absence is a value, not a type: of drives, harmonics, links, and what is recorded."""
    types = set()
    for index in range(100):
        plan = random_plan(index)
        with suppress(PlanError):
            check_compilable(plan)
            given = start_of_loop(plan)
            types.add((*plan.controllers, *map(numba.typeof, given)))
    assert 4 <= len(types) <= 8
