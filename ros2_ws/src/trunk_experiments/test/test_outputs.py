"""One rule for what verbs write: never over an input, never over what exists without --force."""

import hashlib
import os
import shutil
from pathlib import Path

import pytest

from trunk_core.errors import PlanError
from trunk_experiments.console.options import check_folder, check_output, default_name


@pytest.fixture
def told(trunk):
    """Return a function that runs the command and returns its exit code and its error output."""

    def run(words):
        code, _, err = trunk(*words)
        return code, err.strip()

    return run


def hashes(folder: Path):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def here(tmp_path, monkeypatch, short_run):
    """A separate folder: two recordings, one of them in a run's folder, and a parameter file."""
    monkeypatch.chdir(tmp_path)
    recording = short_run("fig8", "pid")
    shutil.copy(recording, "a.mcap")
    Path("fig8").mkdir()
    shutil.copy(recording, "fig8/run.mcap")
    Path("params.yaml").write_text("pid:\n  ros__parameters:\n    gains.p: 12.0\n")
    Path("study.yaml").write_text("scenario: fig6\ncontrollers: [pid]\n")
    return tmp_path


OVER_INPUTS = [
    ("report", "a.mcap", "-o", "a.mcap"),
    ("plot", "a.mcap", "-o", "a.mcap"),
    ("plot", "fig8", "-o", "fig8/run.mcap"),
    ("export", "a.mcap", "-o", "a.mcap"),
    ("export", "fig8", "-o", "fig8/run.mcap"),
    ("recover", "a.mcap", "-o", "a.mcap"),
    ("simulate", "--like", "a.mcap", "-o", "a.mcap"),
    ("plan", "fig6", "--params", "params.yaml"),
    ("plan", "fig6", "--params", "params.yaml", "-o", "params.yaml"),
    ("plan", "params.yaml", "-o", "params.yaml"),
    ("tune", "poles", "--params", "params.yaml", "-o", "params.yaml"),
    ("sweep", "study.yaml", "-o", "study.yaml"),
]


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["", "force"])
@pytest.mark.parametrize("words", OVER_INPUTS, ids=" ".join)
def test_no_verb_writes_over_what_it_reads(here, told, words, force):
    before = hashes(here)
    code, output = told([*words, *force])
    assert code != 0
    assert len(output.splitlines()) == 1
    assert hashes(here) == before


def test_a_link_to_an_input_is_the_input(here, told):
    os.link("a.mcap", "b.mcap")
    Path("c.mcap").symlink_to("a.mcap")
    for name in ("b.mcap", "c.mcap"):
        code, output = told(["export", "a.mcap", "-o", name, "--force"])
        assert (code, "it is read by this command (a.mcap)" in output) == (2, True)


def test_a_file_is_exported_once(here, told):
    before = hashes(here)
    code, output = told(["export", "a.mcap", "-o", "b.csv", "-o", "c.npz", "-o", "b.csv"])
    assert (code, len(output.splitlines())) == (2, 1)
    assert "--output b.csv: it is given twice: give each file once" in output
    assert hashes(here) == before


OVER_OTHERS = [
    ("report", "a.mcap", "-o", "other.html"),
    ("plot", "a.mcap", "-o", "other.png"),
    ("export", "a.mcap", "-o", "other.csv"),
    ("export", "a.mcap", "-o", "other.parquet"),
    ("export", "a.mcap", "-o", "other.npz"),
    ("export", "a.mcap", "-o", "other.mcap"),
    ("recover", "a.mcap", "-o", "other.mcap"),
    ("simulate", "fig6", "--duration", "0.1", "-o", "other.mcap"),
    ("plan", "fig6", "-o", "other.yaml"),
    ("tune", "poles", "-o", "other.yaml"),
]


@pytest.mark.slow
@pytest.mark.parametrize("words", OVER_OTHERS, ids=" ".join)
def test_what_exists_is_replaced_only_by_force(here, told, words):
    Path(words[-1]).write_text("mine")
    before = hashes(here)
    code, output = told(words)
    assert (code, len(output.splitlines())) == (2, 1)
    assert "it exists: give another name, or --force" in output
    assert hashes(here) == before
    code, output = told([*words, "--force"])
    assert code == 0, output
    after = hashes(here)
    assert after.pop(words[-1]) != before.pop(words[-1])
    assert after == before


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize("words", OVER_OTHERS, ids=" ".join)
def test_what_another_command_writes_meanwhile_stays(here, told, words, monkeypatch):
    link = os.link

    def late(part, target):
        target.write_text("theirs")
        link(part, target)

    monkeypatch.setattr(os, "link", late)
    code, output = told(words)
    assert code == 2, output
    kept = f"other.{os.getpid()}{Path(words[-1]).suffix}"
    assert f"{words[-1]}: another command has written it meanwhile; this result is in " in output
    assert output.endswith(kept)
    assert Path(words[-1]).read_text() == "theirs"
    assert Path(kept).is_file()


@pytest.mark.one_in(3)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "made"),
    [
        (("plot", "fig8/run.mcap"), "fig8.png"),
        (("plot", "fig8"), "fig8.png"),
        (("plot", "a.mcap"), "a.png"),
        (("report", "fig8/run.mcap"), "fig8.html"),
        (("report", "a.mcap", "fig8"), "a.html"),
        (("simulate", "fig6", "--duration", "0.1"), "fig6_fuzzy_pid.mcap"),
        (("simulate", "--like", "a.mcap"), "a_again.mcap"),
    ],
    ids=str,
)
def test_defaults_are_named_after_the_run(here, told, words, made):
    before = hashes(here)
    assert told(words)[0] == 0
    assert hashes(here).keys() - before.keys() == {made}
    assert told(words)[0] == 2, "it exists now"


def test_default_names(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")
    assert default_name(Path("run.mcap"), ".png") == Path("mine.png")
    assert default_name(Path(), ".png") == Path("mine.png")
    assert default_name(Path("../x/2026_fig8.pid"), ".html") == Path("2026_fig8.pid.html")
    assert default_name(Path("/"), ".html") == Path("run.html")


def test_outputs_that_cannot_be_written_are_named(tmp_path):
    (tmp_path / "file").write_text("")
    for path, reason in (
        (tmp_path / "no" / "x.csv", "there is no folder"),
        (tmp_path / "file" / "x.csv", "is not a folder"),
        (tmp_path, "it is a folder: name a file"),
        (tmp_path / "x.txt", "the file's name must end in .csv"),
        (tmp_path / "csv", "the file's name must end in .csv"),
    ):
        with pytest.raises(PlanError, match=reason) as caught:
            check_output(path, (".csv",), option="--csv")
        assert str(caught.value).startswith(f"--csv {path}: ")
    assert check_output(Path("/dev/stdout")) == Path("/dev/stdout")


def test_a_folder_with_something_in_it_is_left_alone(here, told):
    assert check_folder(here / "new") == here / "new"
    with pytest.raises(PlanError, match="fig8: the folder is not empty: give another, or --force"):
        check_folder(Path("fig8"))
    assert check_folder(Path("fig8"), force=True) == Path("fig8")
    with pytest.raises(PlanError, match=r"a\.mcap: it is not a folder"):
        check_folder(Path("a.mcap"), force=True)
    before = hashes(here)
    assert told(["paper", "-o", "fig8"])[0] == 2
    assert hashes(here) == before
