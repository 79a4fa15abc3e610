"""A disk that is full, read-only or gone: one clear line, a run that stops in order, no half results."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from trunk_experiments.cli import main, trunk
from trunk_msgs_util.recording.reader import Recording

from ..graph.peer import Peer
from ..graph.processes import Child, Children, until
from ..graph.recordings import states_in
from .disks import Disk, mounted

FULL = "No space left on device"
MODES = {"real time": (), "lock-step": ("--lockstep", "--speed", "1")}


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    with mounted(tmp_path / "disk") as small:
        yield small


def start(children: Children, peer: Peer, folder: Path, *options: str) -> Child:
    run = children.trunk("run", "demo", "--duration", 60, "--output", folder, *options)
    peer.until_event("simulator", "started")
    peer.until_recorded(400)
    return run


def ends(children: Children, child: Child, code: int, *texts: str) -> None:
    """Assert this exit code, a last line with these texts, no traceback anywhere, and no process left."""
    assert child.wait() == code, child.stderr
    children.none_left()
    said = child.stderr + "".join(p.read_text() for p in children.folder.rglob("logs/*.log"))
    assert "Traceback" not in said
    line = child.stderr.splitlines()[-1]
    for text in ("error: ", *texts):
        assert text in line, line


@pytest.mark.graph
@pytest.mark.parametrize("mode", MODES)
def test_disk_gets_full_in_a_run(children: Children, peer: Peer, disk: Disk, mode: str) -> None:
    file = disk.folder / "run" / "run.mcap"
    run = start(children, peer, file.parent, *MODES[mode])
    until(lambda: states_in(file) > 50, "50 states are on the disk")
    disk.fill()
    ends(children, run, 1, "recorder", f"{file}: cannot write: {FULL}; the recording ends here")
    assert states_in(file) > 50
    recording = Recording.open(file)
    assert not recording.complete
    assert recording.end is None


@pytest.mark.graph
def test_disk_is_full_before_a_run(children: Children, disk: Disk) -> None:
    disk.fill()
    run = children.trunk("run", "demo", "--output", disk.folder / "run")
    ends(children, run, 2, f"{disk.folder / 'run' / 'params.yaml'}: {FULL}: free some space")
    recorder = children.node("recorder", f"output:={disk.folder / 'run.mcap'}")
    assert recorder.wait() == 1
    assert f"run.mcap: cannot write: {FULL}" in recorder.stderr
    assert "Traceback" not in recorder.stderr


@pytest.mark.graph
def test_read_only_folder(children: Children, disk: Disk) -> None:
    disk.make_read_only()
    run = children.trunk("run", "demo", "--output", disk.folder / "run")
    ends(children, run, 2, f"{disk.folder / 'run'}: Read-only file system: give a writable place")
    recorder = children.node("recorder", f"output:={disk.folder / 'run.mcap'}")
    ends(children, recorder, 2, "recorder: error: ", "output", "Read-only file system")


@pytest.mark.graph
def test_folder_below_a_file(children: Children, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    run = children.trunk("run", "demo", "--output", "file/run")
    ends(children, run, 2, "file/run", "Not a directory")


@pytest.mark.graph
def test_folder_is_deleted_in_a_run(children: Children, peer: Peer, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run = start(children, peer, folder)
    shutil.rmtree(folder)
    ends(children, run, 1, "recorder", "run.mcap: cannot write: it has been deleted")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    done = CliRunner().invoke(trunk, ["simulate", "demo", "--duration", "1", "-o", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.mark.parametrize(
    "verb",
    [
        "simulate demo --duration 5 -o {disk}/out.mcap",
        "report {run} -o {disk}/out.html",
        "plot {run} -o {disk}/out.png",
        "plot {run} -o {disk}/out.svg",
        "plot {run} -o {disk}/out.pdf",
        "export {run} --csv {disk}/out.csv",
        "export {run} --parquet {disk}/out.parquet",
        "export {run} --npz {disk}/out.npz",
        "export {run} --mcap {disk}/out.mcap",
        "recover {run} -o {disk}/out.mcap",
        "plan demo -o {disk}/out.yaml",
        "tune poles -o {disk}/out.yaml",
        "sweep limit_pulse -o {disk}/out.parquet",
    ],
    ids=lambda verb: verb.split(" -o")[0].split(" {run}")[0] + Path(verb).suffix,
)
@pytest.mark.slow
def test_full_disk_leaves_no_half_result(
    disk: Disk,
    recorded: Path,
    verb: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    disk.fill()
    words = [word.format(disk=disk.folder, run=recorded) for word in verb.split()]
    monkeypatch.setattr(sys, "argv", ["trunk", *words])
    with pytest.raises(SystemExit) as stop:
        main()
    said = capsys.readouterr().err
    assert stop.value.code == 2, said
    assert FULL in said.splitlines()[-1], said
    assert f"{disk.folder}/out" in said.splitlines()[-1]
    left = {path.name for path in disk.folder.iterdir()} - {"filler", "out.parquet.blocks"}
    assert left == set()
