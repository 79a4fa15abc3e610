"""A wrong parameter is refused in one line: its name and value, what is allowed, where it was given."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from trunk_core.errors import StudyError
from trunk_core.parameters.declarations import ParameterError, build
from trunk_core.parameters.parameter_files import ParameterFileError
from trunk_experiments import api
from trunk_runs.nodes import CONTROLLERS, NODES
from trunk_runs.plan import make_plan
from trunk_studies.rows import make_bases
from trunk_studies.study import parse_study

from .refusals import REFUSALS, Refusal

Trunk = Callable[..., tuple[int, str, str]]


def controller(refusal: Refusal) -> str:
    return refusal.node if refusal.node in CONTROLLERS else "pid"


every = pytest.mark.parametrize("refusal", REFUSALS, ids=str)


@every
def test_by_its_class(refusal: Refusal) -> None:
    with pytest.raises(ParameterError) as caught:
        build(NODES[refusal.node].config, refusal.values)
    if not refusal.allowed.startswith("no such"):
        assert caught.value.name == next(iter(refusal.values))
    refusal.check(str(caught.value))


@every
def test_in_a_file(refusal: Refusal, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({refusal.node: {"ros__parameters": refusal.values}}))
    with pytest.raises(ParameterFileError) as caught:
        make_plan("demo", controller(refusal), [str(path)])
    assert str(caught.value).startswith(f"{path}: {refusal.node}: parameter ")
    refusal.check(str(caught.value))


@every
@pytest.mark.one_in(4)
@pytest.mark.parametrize("verb", ["plan -o x.yaml", "simulate -o x.mcap", "run -o x"])
def test_on_the_command_line(
    refusal: Refusal, verb: str, trunk: Trunk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = [f"--set={refusal.node}.{setting}" for setting in refusal.settings]
    code, out, err = trunk(*verb.split(), "demo", "--controller", controller(refusal), *settings)
    assert (code, out) == (2, "")
    assert err.startswith(f"trunk: error: --set {refusal.node}.")
    refusal.check(err.removesuffix("\n"))
    assert list(tmp_path.iterdir()) == []


@every
def test_by_the_library(refusal: Refusal) -> None:
    values = {f"{refusal.node}.{name}": value for name, value in refusal.values.items()}
    with pytest.raises(api.TrunkError) as caught:
        api.plan("demo", controller(refusal), overrides=values)
    assert str(caught.value).startswith(f"overrides: {refusal.node}.")
    refusal.check(str(caught.value))


@every
def test_in_a_study(refusal: Refusal) -> None:
    study = {
        "scenario": "demo",
        "controllers": [controller(refusal)],
        "set": {f"{refusal.node}.{name}": value for name, value in refusal.values.items()},
        "vary": {"draws": {"parameter": "simulator.sensor.seed", "values": [1]}},
    }
    with pytest.raises(StudyError) as caught:
        make_bases(parse_study(yaml.safe_dump(study), "study.yaml"))
    assert str(caught.value).startswith(f"study.yaml: {controller(refusal)}: set {refusal.node}.")
    refusal.check(str(caught.value))


@pytest.mark.one_in(4)
@pytest.mark.parametrize("refusal", [r for r in REFUSALS if controller(r) == "pid"], ids=str)
@pytest.mark.parametrize("make", ["make", "make_vec"])
def test_of_an_environment(refusal: Refusal, make: str) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    settings = [f"{refusal.node}.{setting}" for setting in refusal.settings]
    with pytest.raises(ParameterFileError) as caught:
        getattr(gymnasium, make)("trunk_experiments.gym:trunk/Balance-v0", settings=settings)
    refusal.check(str(caught.value))
