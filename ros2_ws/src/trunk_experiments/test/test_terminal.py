"""No verb lets the text of a file act on the terminal; an ASCII terminal makes no verb fail."""

import fcntl
import io
import json
import os
import struct
import sys
import termios

import pytest

from trunk_experiments.cli import main
from trunk_recording.provenance import ARITHMETIC
from trunk_recording.reader import Recording
from trunk_recording.writer import PROVENANCE, RecordingWriter

EVIL = "\x1b]0;owned\x07\x1b[2J"


def says(monkeypatch: pytest.MonkeyPatch, *words: object, encoding: str = "utf-8") -> str:
    """Return all that the command prints, stdout and stderr together."""
    raw = io.BytesIO()
    screen = io.TextIOWrapper(raw, encoding=encoding)
    monkeypatch.setattr(sys, "argv", ["trunk", *map(str, words)])
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setattr(sys, "stderr", screen)
    with pytest.raises(SystemExit):
        main()
    screen.flush()
    return raw.getvalue().decode(encoding)


@pytest.fixture
def evil(tmp_path):
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path)
    told = {"scenario": EVIL, "arithmetic": ARITHMETIC, EVIL: "value"}
    writer.add_metadata(PROVENANCE, told)
    writer.channel(f"/{EVIL}", "sensor_msgs/msg/JointState")
    writer.finish(complete=False, reason=EVIL)
    return path


@pytest.mark.parametrize("verb", ["info", "info --check", "verify", "metrics"])
def test_names_and_reasons_do_not_reach_the_terminal(monkeypatch, evil, verb):
    said = says(monkeypatch, *verb.split(), evil)
    assert "\\u001b" in said
    assert not set(said) & {"\x1b", "\x07"}


def test_an_error_shows_the_name_that_was_given(monkeypatch):
    said = says(monkeypatch, "simulate", EVIL, "-o", "x.mcap")
    assert said.startswith("trunk: error: no scenario ")
    assert not set(said) & {"\x1b", "\x07"}


@pytest.mark.parametrize(
    "words", ["list scenarios", "simulate demo --set simulator.plant.mass=3 -o x.mcap"]
)
def test_a_terminal_of_80_columns_breaks_no_word(trunk, monkeypatch, words):
    wanted = "".join(trunk(*words.split())[1:])
    master, slave = os.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    with os.fdopen(slave, "w") as screen:
        monkeypatch.setattr(sys, "stdout", screen)
        monkeypatch.setattr(sys, "stderr", screen)
        with pytest.raises(SystemExit):
            main()
    shown = os.read(master, 4096).decode()  # less than that waits until it is read
    rows = [line[i : i + 80] for line in shown.split("\r\n") for i in range(0, len(line), 80)]
    assert max(map(len, shown.split("\r\n"))) > 80
    assert [word for row in rows for word in row.split()] == wanted.split()
    assert shown.count("\r\n") == wanted.count("\n")


LONG = 3000 * "n"


@pytest.mark.parametrize(
    "words",
    [
        (LONG,),
        ("list", LONG),
        ("verify", LONG),
        ("verify", 400 * "\x1b"),
        ("simulate", LONG, "-o", "x.mcap"),
        ("simulate", "demo", "-o", LONG),
        ("simulate", "demo", "-o", "x.mcap", f"--{LONG}"),
        ("simulate", "demo", "-o", "x.mcap", "--set", f"pid.{LONG}=3"),
        ("simulate", "demo", "-o", "x.mcap", "--push", LONG),
        ("plan", "demo", "-o", "x.yaml", "--namespace", LONG),
    ],
    ids=lambda words: " ".join(words)[:40],
)
def test_no_line_is_longer_than_500_characters(trunk, words):
    code, out, err = trunk(*words, "--json")
    assert (code, err.count("\n")) == (2, 1)
    assert len(err) <= 500
    assert err == f"trunk: error: {json.loads(out)['error']}\n"


def test_json_has_the_content_of_the_file(monkeypatch, evil):
    said = says(monkeypatch, "info", evil, "--json")
    assert json.loads(said)["provenance"] == dict(Recording.open(evil).provenance)
    assert not set(said) & {"\x1b", "\x07"}


def test_an_ascii_terminal_shows_metrics(monkeypatch, tmp_path):
    path = tmp_path / "run.mcap"
    says(monkeypatch, "simulate", "demo", "--duration", 0.2, "-o", path, encoding="ascii")
    said = says(monkeypatch, "metrics", path, encoding="ascii")
    assert "largest angle" in said
