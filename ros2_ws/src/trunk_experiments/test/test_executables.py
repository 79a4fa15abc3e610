"""What a signal does to a verb, by what it interrupts; how `params` and `run` exit."""

import os
import subprocess
import sys
from importlib import import_module

import pytest

from trunk_experiments import executables


class EndedError(Exception):
    """Stands for the end of the process."""


@pytest.mark.parametrize(
    ("inside", "verb", "expected"),
    [
        ("trunk_evidence", "verify", executables._Interrupted),
        ("numba.core.codegen", "verify", EndedError),
        ("llvmlite.binding.ffi", "simulate", EndedError),
        *(
            ("numba.core.codegen", verb, executables._Interrupted)  # it has workers to end
            for verb in ("sweep", "tune optimise", "study map", "study report")
        ),
    ],
)
def test_no_signal_raises_inside_the_compiler(monkeypatch, inside, verb, expected):
    def end(number):
        raise EndedError

    monkeypatch.setattr(executables, "_end", end)
    monkeypatch.setattr(executables.early_signals, "end_by", lambda action: None)
    monkeypatch.setattr(sys, "argv", ["trunk", *verb.split()])
    code = {"__name__": inside, "unwind": executables._unwind}
    exec("def compile_it(): unwind(2)", code)
    with pytest.raises(expected):
        code["compile_it"]()


def test_the_end_gives_a_terminal_its_cursor_back():
    master, slave = os.openpty()
    words = "from trunk_experiments.executables import _end; _end(2)"
    done = subprocess.run([sys.executable, "-c", words], stderr=slave, check=False)
    assert (done.returncode, os.read(master, 99)) == (130, b"\x1b[?25hinterrupted\r\n")


@pytest.mark.parametrize("verb", ["verify", "run"])
def test_no_import_swallows_a_signal(monkeypatch, tmp_path, verb):
    ended = []
    monkeypatch.setattr(executables, "_end", ended.append)
    monkeypatch.setattr(executables.early_signals, "end_by", lambda action: None)
    monkeypatch.setattr(sys, "argv", ["trunk", verb])
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    (tmp_path / f"catches_all_of_{verb}.py").write_text(
        "from trunk_experiments import executables\n"
        "try:\n    executables._unwind(2)\nexcept BaseException:\n    pass\n"
    )
    import_module(f"catches_all_of_{verb}")
    assert ended == [2]


@pytest.mark.parametrize(
    ("verb", "code", "at_once"),
    [("params", 1, True), ("run", 0, True), ("params", "told", False), ("verify", 1, False)],
)
def test_what_has_loaded_rclpy_exits_with_its_code_without_unloading_it(
    monkeypatch, verb, code, at_once
):
    def leave(number):
        assert number == code
        raise EndedError

    monkeypatch.setattr(executables.os, "_exit", leave)
    monkeypatch.setattr(sys, "argv", ["trunk", verb])
    if at_once:
        with pytest.raises(EndedError):
            executables._leave(SystemExit(code))
    else:
        executables._leave(SystemExit(code))
