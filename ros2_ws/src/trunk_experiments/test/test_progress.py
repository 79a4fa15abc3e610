"""How far the work is: a bar on a terminal, else a line for each tenth of long work."""

import io

import pytest
from rich.console import Console

from trunk_experiments.console import terminal
from trunk_experiments.console.terminal import progress_bar, steps_told


def test_a_line_for_each_tenth(capsys):
    with progress_bar("runs") as tell:
        for done in range(1001):
            tell(done, 1000, "best 0.5" if done == 1000 else "")
    out, err = capsys.readouterr()
    assert out == ""
    *first, last = err.splitlines()
    assert first == [f"trunk: runs: {percent} %" for percent in range(10, 100, 10)]
    assert last == "trunk: runs: 100 %, best 0.5"


def test_a_line_says_how_far_it_is_not_the_tenth(capsys):
    with progress_bar("demo") as tell:
        for done in (1.7, 1.9, 2.7, 8.8, 10.0):
            tell(done, 10.0, f"{done:g} of 10 s")
    assert capsys.readouterr().err.splitlines() == [
        "trunk: demo: 17 %, 1.7 of 10 s",
        "trunk: demo: 27 %, 2.7 of 10 s",
        "trunk: demo: 88 %, 8.8 of 10 s",
        "trunk: demo: 100 %, 10 of 10 s",
    ]


@pytest.mark.parametrize(
    ("of", "steps", "lines"),
    [(99.0, 10, 0), (100.0, 10, 10), (100.0, 3, 3), (100.0, 1, 1), (0.0, 1, 0)],
)
def test_short_work_says_nothing_and_no_line_comes_twice(capsys, of, steps, lines):
    with progress_bar("reading a", lines_from=100.0) as tell:
        for step in range(1, steps + 1):
            tell(of * step / steps, of)
            tell(of * step / steps, of)
    assert len(capsys.readouterr().err.splitlines()) == lines


def test_control_characters_in_a_name_do_not_reach_the_log(capsys):
    with progress_bar("reading \x1b[2J") as tell:
        tell(1, 1)
    with steps_told() as say:
        say("run \x1b[2J")
    assert "\x1b" not in capsys.readouterr().err


def test_a_terminal_shows_a_bar(monkeypatch, capsys):
    screen = io.StringIO()
    monkeypatch.setattr(terminal, "_on_terminal", lambda: True)
    monkeypatch.setattr(
        terminal,
        "console",
        lambda **_: Console(file=screen, force_terminal=True, width=80),
    )
    with progress_bar("generations") as tell:
        tell(3, 3, "best 0.5")
    for text in ("generations", "100%", "best 0.5"):
        assert text in screen.getvalue()
    assert capsys.readouterr() == ("", "")


def test_steps_by_their_names(capsys):
    with steps_told() as say:
        say("offline run 1 of 2")
        say("drawing")
    assert capsys.readouterr() == ("", "trunk: offline run 1 of 2\ntrunk: drawing\n")
