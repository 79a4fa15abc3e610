"""The errors of all packages are one family, and the command line knows only its root."""

import sys
from importlib import import_module
from inspect import getmembers, isclass
from pkgutil import walk_packages

import pytest

from trunk_core import PACKAGES
from trunk_core.errors import (
    LiveParametersError,
    PlanError,
    RecordingError,
    RunError,
    StudyError,
    SweepError,
    TrunkError,
)
from trunk_core.parameters.declarations import ParameterError
from trunk_core.parameters.parameter_files import ParameterFileError
from trunk_experiments import cli
from trunk_sim.simulation import DivergedError

# These never reach a user. Readers turn most of them into a RecordingError that names the file.
INTERNAL = {
    "DamageError",
    "ChecksumError",
    "UnreadableError",
    "TrailingError",
    "NoKnobError",  # a parameter is none
    "_Interrupted",
}


def exceptions():
    for package in PACKAGES:
        folder = import_module(package).__path__
        for module in walk_packages(folder, f"{package}."):
            if module.name.endswith("__main__"):
                continue
            for name, kind in getmembers(import_module(module.name), isclass):
                ours = kind.__module__.split(".")[0] in PACKAGES
                if ours and issubclass(kind, BaseException) and not issubclass(kind, Warning):
                    yield name, kind


def test_every_exception_is_of_the_family():
    pytest.importorskip("rclpy")
    found = dict(exceptions())
    assert {"PlanError", "DivergedError", "RecordingError"} <= set(found)
    strangers = {name for name, kind in found.items() if not issubclass(kind, TrunkError)}
    assert strangers == INTERNAL


ERRORS = [
    (PlanError("no plan"), 2),
    (StudyError("no study"), 2),
    (ParameterError("gains.p", -1.0, "at least 0"), 2),
    (ParameterFileError("no mapping"), 2),
    (RecordingError("no file"), 2),
    (FileExistsError("it exists"), 2),
    (RunError("it fell silent"), 1),
    (SweepError("a worker was killed"), 1),
    (LiveParametersError("no node"), 1),
    (DivergedError("the loop is unstable"), 1),
]


@pytest.mark.parametrize(("error", "code"), ERRORS, ids=lambda value: type(value).__name__)
def test_an_error_gives_one_line_and_its_exit_code(error, code, monkeypatch, capsys):
    def verb(prog_name, standalone_mode):
        raise error

    monkeypatch.setattr(cli, "trunk", verb)
    monkeypatch.setattr(sys, "argv", ["trunk"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == code
    assert capsys.readouterr().err == f"trunk: error: {error}\n"


def test_a_defect_keeps_its_traceback(monkeypatch):
    def verb(prog_name, standalone_mode):
        raise ZeroDivisionError

    monkeypatch.setattr(cli, "trunk", verb)
    with pytest.raises(ZeroDivisionError):
        cli.main()
