"""docs/recording.md: its programs as printed, which read a recording without this project and sign it."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

import trunk_experiments.api as trunk

from .finished import finished

PAGE = Path(__file__).parents[1] / "docs" / "recording.md"


@pytest.mark.slow
def test_a_recording_is_read_by_the_programs_of_the_page(tmp_path, monkeypatch, capsys):
    programs = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    assert [set(re.findall(r"from (\w+)", program)) for program in programs] == [
        {"mcap_ros2"},
        {"trunk_recording"},
    ]
    monkeypatch.chdir(tmp_path)
    run = trunk.simulate(trunk.plan("demo", duration=0.5), output="fuzzy.mcap")
    for program in programs:
        exec(program, {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(run) + 1
    assert lines[-1] == lines[-2] == f"{run.t[-1]} {{'hip': {run.x[-1]}, 'trunk': {run.theta[-1]}}}"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a short run, in the working directory."""
    monkeypatch.chdir(tmp_path)
    return trunk.simulate(trunk.plan("demo", duration=0.05), output="run.mcap").path


@pytest.mark.skipif(
    shutil.which("ssh-keygen") is None, reason="no ssh-keygen: install openssh-client"
)
def test_a_signature_finds_a_changed_byte(run, tmp_path, monkeypatch):
    """The page's lines and the command in the note, as printed, with the real ssh-keygen."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    key = tmp_path / ".ssh" / "id_ed25519"
    finished(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)

    def holds(line):
        done = finished(["bash", "-c", line])
        return done.returncode == 0, done.stdout + done.stderr

    section = PAGE.read_text(encoding="utf-8").partition("\n## Signatures\n")[2]
    *lines, check = section.partition("```bash\n")[2].partition("```")[0].splitlines()
    for line in (*lines, check):
        held, said = holds(line)
        assert held, (line, said)
    assert said.startswith('Good "trunk" signature for me@example.org')
    (note,) = trunk.verify(run).notes
    noted = note.partition(": ")[2].replace("WHO", "me@example.org")
    assert noted == check
    whole = bytearray(run.read_bytes())
    for place in (0, len(whole) // 2, len(whole) - 1):
        whole[place] ^= 1
        run.write_bytes(whole)
        assert not holds(check)[0]
        whole[place] ^= 1
    run.write_bytes(whole)
    assert holds(check)[0]
    assert not holds(check.replace("me@", "another@"))[0]
    assert not holds(check.replace("trunk", "file"))[0]


@pytest.mark.parametrize(
    ("name", "signature"),
    [
        ("run.mcap", "run.mcap.sig"),
        ("run.mcap", "run.sig"),
        ("a run", "a run.sig"),
        ("bag/bag_0.mcap", "bag/bag_0.mcap.sig"),
    ],
)
def test_a_signature_beside_a_file_is_told_and_judges_nothing(run, tmp_path, name, signature):
    """Whatever is in it; of a folder, that of its file."""
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    run.rename(file)
    asked = Path(name).parent if "/" in name else Path(name)
    without = trunk.verify(asked)
    assert (without.verdict, without.notes) == ("verified", [])
    (tmp_path / signature).write_text("no signature at all")
    told = trunk.verify(asked)
    assert (told.verdict, len(told.notes)) == ("verified", 1)
    words = shlex.split(told.notes[0])
    assert words[-4:] == ["-s", signature, "<", name]
