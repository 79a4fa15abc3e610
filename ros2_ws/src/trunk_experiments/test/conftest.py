import shutil
import sys

import pytest

from trunk_experiments.cli import main

from ...trunk_runs.test.short_runs import hostile_run, short_run  # noqa: F401
from ...trunk_views.test.page_driver import opened, reported, without_pictures  # noqa: F401
from .verbs import furnish


@pytest.fixture(scope="session")
def furnished(tmp_path_factory):
    """A folder with files of each kind (`furnish`), to be copied."""
    return furnish(tmp_path_factory.mktemp("furnished"))


@pytest.fixture
def command_says(monkeypatch, capfd):
    """Return a function that runs ``trunk`` and returns its exit code, stdout and stderr.

    What processes and libraries print is in them, too.
    """

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["trunk", *map(str, words)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as stop:
            main()
        captured = capfd.readouterr()
        return stop.value.code or 0, captured.out, captured.err

    return run


@pytest.fixture
def recordings_here(tmp_path, monkeypatch, furnished):
    """Go to a folder with files of each kind."""
    shutil.copytree(furnished, tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
