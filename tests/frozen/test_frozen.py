"""Runs record what was frozen of them, to the bit: only here shows what changes on all paths at once."""

import sys
from typing import Any

import pytest

from ..finished import finished
from .check import ROOT, differences, frozen_runs
from .runs import LOCKSTEP, OFFLINE


def shares(names: list[str], count: int) -> list[Any]:
    """Return shares of about the same size, each with runs of every sort."""
    return [pytest.param(names[number::count], id=str(number)) for number in range(count)]


@pytest.mark.slow
@pytest.mark.one_in(20)
@pytest.mark.parametrize("names", shares([n for n in OFFLINE if not n.startswith("long")], 20))
def test_offline_runs_are_as_they_were(names: list[str]) -> None:
    assert list(differences(names)) == []


@pytest.mark.slow
@pytest.mark.one_in(8)
@pytest.mark.parametrize("name", [name for name in OFFLINE if name.startswith("long")])
def test_compiled_runs_are_as_they_were(name: str) -> None:
    assert list(differences([name])) == []


@pytest.mark.slow
@pytest.mark.one_in(8)
@pytest.mark.parametrize("names", shares(list(LOCKSTEP), 8))
def test_runs_in_lockstep_are_as_they_were(names: list[str]) -> None:
    """In a process of their own, which loads another rclpy."""
    done = finished([sys.executable, "-m", "tests.frozen.check", *names], cwd=ROOT)
    assert (done.returncode, done.stdout) == (0, f"{len(names)} runs, 0 differences\n"), done.stderr


def test_every_run_is_frozen() -> None:
    assert list(frozen_runs()) == [*OFFLINE, *LOCKSTEP]
