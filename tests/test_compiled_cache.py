"""Compiled code is kept on disk, by one process at a time."""

import errno
import fcntl
import os
import resource
import shutil
import sys
from importlib import import_module, invalidate_caches
from itertools import chain, count
from pathlib import Path
from threading import Event

import pytest
from numba.core.caching import IndexDataCacheFile

from trunk_core import compiled as module
from trunk_core.compiled import compiled


def half(number: float) -> float:
    return number / 2.0


def test_one_process_at_a_time_adds_to_the_cache_of_compiled_code(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    save = IndexDataCacheFile.save
    saved = []

    def watched(file, key, data):
        (path,) = tmp_path.rglob("lock")
        with path.open() as lock, pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        saved.append(key)
        save(file, key, data)

    monkeypatch.setattr(IndexDataCacheFile, "save", watched)
    assert compiled(half)(3.0) == 1.5
    assert saved


def test_a_process_forked_meanwhile_does_not_keep_the_lock(monkeypatch, tmp_path):
    """It has the same open file, as a duplicate of its descriptor is."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    save = IndexDataCacheFile.save
    kept = []

    def watched(file, key, data):
        (path,) = tmp_path.rglob("lock")
        descriptors = list(Path("/proc/self/fd").iterdir())
        kept.extend(os.dup(int(fd.name)) for fd in descriptors if fd.exists() and fd.samefile(path))
        save(file, key, data)

    monkeypatch.setattr(IndexDataCacheFile, "save", watched)
    compiled(half)(3.0)
    assert kept
    (path,) = tmp_path.rglob("lock")
    with path.open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    for descriptor in kept:
        os.close(descriptor)


def test_who_waits_for_longer_than_a_compilation_compiles_for_itself(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said, is_said = [], Event()
    monkeypatch.setattr(module, "_LATE_S", 0.0)
    monkeypatch.setattr(module, "_say", lambda what: (said.append(what), is_said.set()))
    times = chain([0.0], (module._COMPILE_S * is_said.is_set() for _ in count()))
    monkeypatch.setattr(module.time, "monotonic", times.__next__)
    twin = compiled(half)
    path = module.cache_folder() / module.fingerprint(half) / "lock"
    path.write_text("4711")
    with path.open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert twin(3.0) == 1.5
    assert said[0] == "waiting for process 4711, which is compiling half"
    assert not list(tmp_path.rglob("*.nbi"))


def test_a_long_compilation_is_told(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said, is_said = [], Event()
    monkeypatch.setattr(module, "_LATE_S", 0.0)
    monkeypatch.setattr(module, "_say", lambda what: (said.append(what), is_said.set()))
    monkeypatch.setattr(IndexDataCacheFile, "save", lambda file, key, data: is_said.wait())
    assert compiled(half)(3.0) == 1.5
    assert said[-1] == "compiling half, once for each version of its sources"


@pytest.mark.parametrize("part", [0.0, 0.5])
def test_the_cache_of_compiled_code_may_be_damaged(part, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert compiled(half)(3.0) == 1.5
    kept = [path for path in tmp_path.rglob("*.nb?") if path.is_file()]
    assert {path.suffix for path in kept} == {".nbi", ".nbc"}
    for path in kept:
        path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    assert compiled(half)(3.0) == 1.5


def test_the_folder_may_go_before_the_code_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    twin = compiled(half)
    shutil.rmtree(tmp_path / "trunk")
    assert twin(3.0) == 1.5
    assert list(tmp_path.rglob("*.nbi"))


LAW = '''"""A law."""

SIGNS = (1.0, -1.0)


def sign(x):
    return SIGNS[1] if x < 0.0 else SIGNS[0]


def update(x, gain=2.0):
    """Return the torque."""
    return 3.0 * gain * sign(x)  # it saturates
'''


@pytest.mark.parametrize(
    ("old", "new", "recompiled"),
    [
        ("A law.", "Another law.\n\nIn three lines.", False),
        ("Return the torque.", "Give the torque in N m.", False),
        ("  # it saturates", "", False),
        ("3.0", "4.0", True),
        ("gain=2.0", "gain=5.0", True),
        ("(1.0, -1.0)", "(1.0, -2.0)", True),
        ("x < 0.0", "x <= 0.0", True),
    ],
)
def test_code_is_compiled_anew_when_its_meaning_changes(
    monkeypatch, tmp_path, old, new, recompiled
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    given = []
    for folder, text in (("a", LAW), ("b", LAW.replace(old, new))):  # in another checkout
        path = tmp_path / folder / "law.py"
        path.parent.mkdir()
        path.write_text(text)
        monkeypatch.syspath_prepend(str(path.parent))
        monkeypatch.delitem(sys.modules, "law", raising=False)
        law = import_module("law")
        twin = compiled(law.update)
        given.append([twin(x) for x in (1.0, 0.0, -1.0)])
        assert given[-1] == [law.update(x) for x in (1.0, 0.0, -1.0)]
    assert (given[0] != given[1]) == recompiled
    assert sum(twin.stats.cache_hits.values()) == (not recompiled)


def test_code_is_of_the_function_as_loaded_and_of_one_of_its_name(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    path = tmp_path / "law_as_loaded.py"
    path.write_text(
        "def made(kind):\n    return (lambda x: x + 1.0) if kind else (lambda x: x * 10.0)\n"
    )
    law = import_module(path.stem)
    path.write_text(path.read_text().replace("+ 1.0", "+ 20.0"))
    assert [compiled(law.made(kind))(3.0) for kind in (0, 1, 0)] == [30.0, 4.0, 30.0]
    monkeypatch.delitem(sys.modules, path.stem)
    invalidate_caches()
    assert compiled(import_module(path.stem).made(1))(3.0) == 23.0


def test_on_a_full_disk_nothing_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        assert compiled(half)(3.0) == 1.5
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_without_locks_nothing_is_kept(monkeypatch, tmp_path):
    """Some network file systems have none."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def none(file, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    assert compiled(half)(3.0) == 1.5
    assert not list(tmp_path.rglob("*.nbi"))
