"""The recorder's file reaches the disk beside the loop; a disk that refuses ends the recording by name."""

import errno
import os
import threading

import pytest

from trunk_core import topics
from trunk_recording.reader import Recording
from trunk_recording.writer import RecordingWriter


class Disk:
    """Stands for `os.fdatasync`: notes the threads that wait for it, and may refuse the first times."""

    def __init__(self, number=0, times=1 << 30):
        self.number = number
        self.times = times
        self.threads = []
        self.asked = threading.Event()

    def __call__(self, descriptor):
        self.threads.append(threading.current_thread())
        self.asked.set()
        if self.number and len(self.threads) <= self.times:
            raise OSError(self.number, os.strerror(self.number))


@pytest.fixture
def run(tmp_path, monkeypatch):
    def begin(disk):
        monkeypatch.setattr(os, "fdatasync", disk)
        file = RecordingWriter(tmp_path / "run.mcap", compression="none")
        file.channel(f"/{topics.JOINT_STATES}", topics.JOINT_STATE_TYPE)
        return file

    return begin


def synced(file):
    file.flush()
    file.sync_beside()


def watch(file):
    while True:
        file.check()


def finish(file):
    file.finish(complete=True, reason="finished", sync=True)


def test_it_waits_for_the_disk_beside_the_loop_and_at_the_end(run):
    file = run(disk := Disk())
    synced(file)
    assert disk.asked.wait()
    assert threading.current_thread() not in disk.threads
    finish(file)
    assert disk.threads[-1] is threading.current_thread()


def test_the_disk_is_told_the_files_name_once(run, tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(os, "fsync", lambda of: told.append(os.path.samestat(os.fstat(of), here)))
    here = tmp_path.stat()
    file = run(Disk())
    for _ in range(2):
        synced(file)
    finish(file)
    assert told == [True]


def test_a_disk_that_refuses_ends_the_recording(run, tmp_path):
    file = run(disk := Disk(errno.EIO))
    synced(file)
    assert disk.asked.wait()
    with pytest.raises(OSError, match="Input/output error") as failed:
        watch(file)
    assert failed.value.filename == str(tmp_path / "run.mcap")


def test_what_the_disk_refused_once_is_told_at_the_end(run, tmp_path):
    """Linux tells of a lost write once: the next call succeeds."""
    file = run(Disk(errno.EIO, times=1))
    synced(file)
    with pytest.raises(OSError, match="Input/output error"):
        finish(file)
    assert not Recording.open(tmp_path / "run.mcap").complete


def test_a_pipe_has_no_disk(run):
    file = run(Disk(errno.EINVAL))
    synced(file)
    finish(file)
