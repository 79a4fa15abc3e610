"""A disk that is full, read-only or gone: one clear line, a run that stops cleanly, no partial results."""

import errno
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path

import pytest

from trunk_core.errors import RunError
from trunk_msgs_util.source import process_id
from trunk_recording.reader import Recording
from trunk_recording.writer import PROVENANCE, RecordingWriter
from trunk_runs.graph import _own_recording
from trunk_runs.processes import NodeProcess

from ..graph.peer import Peer
from ..graph.processes import Child, Children, until
from ..graph.recordings import finished_file, states_in
from ..graph.verbs import said as told

FULL = "No space left on device"
MODES = {"real time": (), "lock-step": ("--lockstep", "--speed", "1")}


_BLOCK = bytes(4096)


class Disk:
    """A mounted tmpfs, to be filled or made read-only."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fill(self) -> None:
        """Write until there is no room for another page."""
        with (self.folder / "filler").open("ab", buffering=0) as file:
            try:
                while file.write(_BLOCK):
                    pass
            except OSError as error:
                if error.errno != errno.ENOSPC:
                    raise

    def make_read_only(self) -> None:
        _mount("-o", "remount,ro", str(self.folder))


def _mount(*arguments: str) -> None:
    if subprocess.run(["mount", *arguments], capture_output=True, check=False).returncode:
        pytest.skip("no small disk can be mounted here (root is needed)")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    folder = tmp_path / "disk"
    folder.mkdir()
    _mount("-t", "tmpfs", "-o", "size=4m", "trunk-test", str(folder))
    yield Disk(folder)
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def start(children: Children, peer: Peer, folder: Path, *options: str) -> Child:
    run = children.trunk("run", "demo", "--duration", 3600, "--output", folder, *options)
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
@pytest.mark.parametrize(
    "mode", ["real time", pytest.param("lock-step", marks=pytest.mark.one_in(8))]
)
def test_disk_fills_up_during_a_run(children: Children, peer: Peer, disk: Disk, mode: str) -> None:
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
@pytest.mark.one_in(8)  # noticed as a truncated file is
def test_folder_is_deleted_during_a_run(children: Children, peer: Peer, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    run = start(children, peer, folder)
    shutil.rmtree(folder)
    ends(children, run, 1, "recorder", "run.mcap: cannot write: it has been", "deleted")


def replaced(file: Path, other: Path) -> None:
    shutil.copy(other, file.with_name("other.mcap")).replace(file)


def truncated(file: Path, other: Path) -> None:
    os.truncate(file, 1000)


HARMS = {
    replaced: "another file has been put in its place",
    truncated: "it has been truncated",
}


@pytest.mark.graph
@pytest.mark.parametrize(
    "harm",
    [pytest.param(replaced, marks=pytest.mark.one_in(8)), truncated],
    ids=lambda harm: harm.__name__,
)
def test_recording_is_changed_during_a_run(
    children: Children, peer: Peer, tmp_path: Path, recorded: Path, harm: Callable[..., None]
) -> None:
    file = tmp_path / "run" / "run.mcap"
    run = start(children, peer, file.parent)
    harm(file, recorded)
    ends(children, run, 1, "recorder", f"run.mcap: cannot write: {HARMS[harm]}")
    assert run.stdout == ""  # no metrics of another file


@pytest.mark.graph
def test_second_recorder_on_one_file(children: Children, peer: Peer, tmp_path: Path) -> None:
    first = children.node("recorder", "output:=run.mcap")
    peer.until_up("recorder")
    until((tmp_path / "run.mcap").exists, "the first one has its file")
    another = ("output:=run.mcap", "overwrite:=true", "-r", "__node:=another")
    second = children.node("recorder", *another, name="second")
    assert second.wait() == 2
    said = second.stderr.splitlines()
    assert said[-1].startswith("recorder: error: parameter 'output': ")
    assert "run.mcap is being written by another process" in said[-1]
    assert first.stop() == 1  # of no run at all
    assert finished_file(tmp_path / "run.mcap")


def test_another_file_in_place_of_the_recording_is_noticed(recorded: Path, tmp_path: Path) -> None:
    process = subprocess.Popen(["true"])
    own = NodeProcess("recorder", process, tmp_path / "log", BytesIO(), process_id())
    process.wait()
    with pytest.raises(RunError, match="another file has replaced this run's"):
        _own_recording(recorded, own)
    file = tmp_path / "own.mcap"
    with RecordingWriter(file) as writer:
        writer.add_metadata(PROVENANCE, {"process": process_id()})
    assert _own_recording(file, own).complete


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    told("simulate", "demo", "--duration", 1, "-o", path)
    return path


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "verb",
    [
        "simulate demo --duration 5 -o {disk}/out.mcap",
        "report {run} -o {disk}/out.html",
        "plot {run} -o {disk}/out.png",
        "plot {run} -o {disk}/out.svg",
        "plot {run} -o {disk}/out.pdf",
        "export {run} -o {disk}/out.csv",
        "export {run} -o {disk}/out.parquet",
        "export {run} -o {disk}/out.npz",
        "export {run} -o {disk}/out.mcap",
        "recover {run} -o {disk}/out.mcap",
        "plan demo -o {disk}/out.yaml",
        "tune poles -o {disk}/out.yaml",
        "sweep limit_pulse -o {disk}/out.parquet",
    ],
    ids=lambda verb: verb.split(" -o")[0].split(" {run}")[0] + Path(verb).suffix,
)
@pytest.mark.slow
def test_full_disk_leaves_no_partial_result(
    disk: Disk, recorded: Path, verb: str, trunk: Callable[..., tuple[int, str, str]]
) -> None:
    disk.fill()
    words = [word.format(disk=disk.folder, run=recorded) for word in verb.split()]
    code, _, said = trunk(*words)
    assert code == 2, said
    assert FULL in said.splitlines()[-1], said
    assert f"{disk.folder}/out" in said.splitlines()[-1]
    left = {path.name for path in disk.folder.iterdir()} - {"filler", "out.parquet.blocks"}
    assert left == set()
