"""``trunk study map`` as a user sees it: what cannot be drawn is refused before anything is swept."""

from __future__ import annotations

import io

import pytest
from click.testing import CliRunner
from rich.console import Console

from trunk_experiments.cli import trunk
from trunk_experiments.console import progress

STUDY = """
scenario: fig6
params: profile_practical
rate: 200
duration: 2.5
controllers: [pid]
set: {simulator.hip.mode: prescribed, simulator.path.amplitude: 0.03}
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.01, 0.3]}
  gain: {parameter: pid.gains.p, as: factor, values: [1.0, 1.5]}
"""
MODE = "  mode: {parameter: simulator.hip.mode, values: [passive, prescribed]}\n"
ONE = STUDY[: STUDY.index("  gain:")]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(STUDY)
    (tmp_path / "mode.yaml").write_text(STUDY + MODE)
    (tmp_path / "one.yaml").write_text(ONE)
    drawn = (
        "  delay: {parameter: simulator.sensor.delay, distribution: uniform, low: 0.0, high: 0.1}\n"
    )
    (tmp_path / "none.yaml").write_text(ONE[: ONE.index("  delay:")] + drawn)
    return tmp_path


def run(*arguments):
    done = CliRunner().invoke(trunk, ["study", "map", *map(str, arguments)])
    return done, f"{done.exception} {done.output}"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["mine.yaml", "-o", "x.jpg"], "x.jpg: the file's name must end in .png, .svg or .pdf"),
        (["mine.yaml", "-o", "none/x.png"], "there is no folder none"),
        (["mine.yaml", "--metric", "nix"], "no metric 'nix': one of "),
        (["mine.yaml", "--x", "nix"], "'nix' is not a grid variable; available: delay, gain"),
        (["mine.yaml", "--x", "gain", "--y", "gain"], "--x and --y are both 'gain'"),
        (["mode.yaml", "--x", "mode"], "'mode' holds no numbers"),
        (
            ["one.yaml", "--y", "delay"],
            "--y delay: there is no other grid variable: give --x delay",
        ),
        (["none.yaml"], "a map needs one or two grid variables; it has none"),
        (["nix.yaml"], "no study 'nix.yaml'"),
    ],
    ids=str,
)
def test_what_cannot_be_drawn_is_not_swept(here, arguments, line):
    before = sorted(here.iterdir())
    done, told = run(*arguments)
    assert done.exit_code != 0
    assert line in told
    assert sorted(here.iterdir()) == before


def test_a_study_is_swept_and_drawn(here):
    done, told = run("mine.yaml")
    assert done.exit_code == 0, told
    assert {path.name for path in here.iterdir()} >= {"mine.parquet", "mine.png"}
    done, told = run("mine.yaml", "-o", "again.png")
    assert "mine.parquet: it exists: give it in place of mine.yaml, or delete it" in told


def test_one_variable_gives_curves(here):
    done, message = run("one.yaml", "-o", "one.svg")
    assert done.exit_code == 0, message
    assert message.splitlines()[-1].endswith("one.svg: 1 controllers over delay")
    picture = (here / "one.svg").read_text()
    for label in ("delay (s)", "steady-state error, RMS (°)", "more than half fell", "Floquet"):
        assert label in picture


@pytest.mark.slow
def test_a_picture_is_replaced_only_by_force(here):
    run("mine.yaml", "-o", "x.png")
    (here / "mine.png").write_text("mine")
    for named in ((), ("-o", "mine.png")):
        done, told = run("mine.parquet", *named)
        assert done.exit_code != 0
        assert "mine.png: it exists: give another name, or --force" in told
        assert (here / "mine.png").read_text() == "mine"
    done, told = run("mine.parquet", "--force")
    assert done.exit_code == 0, told
    assert (here / "mine.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_one_given_axis_leaves_the_other_variable_to_the_other_axis(here):
    _, told = run("mine.yaml", "--y", "delay")
    assert "over gain and delay" in told


@pytest.mark.slow
def test_a_terminal_shows_the_progress(here, monkeypatch):
    screen = io.StringIO()

    def terminal(**_):
        return Console(file=screen, force_terminal=True, width=100)

    monkeypatch.setattr(progress, "console", terminal)
    monkeypatch.setattr(progress, "_on_terminal", lambda: True)
    done, told = run("mine.yaml")
    assert done.exit_code == 0, told
    for text in ("runs", "Floquet multipliers", "100%"):
        assert text in screen.getvalue()
