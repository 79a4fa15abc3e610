"""Compiled code is kept on disk, by one process at a time."""

from __future__ import annotations

import errno
import fcntl
import shutil
import sys
from importlib import import_module

import pytest
from numba.core.caching import IndexDataCacheFile

from trunk_msgs_util.compiled import compiled


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


def test_without_locks_nothing_is_kept(monkeypatch, tmp_path):
    """Some network file systems have none."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def none(file, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    assert compiled(half)(3.0) == 1.5
    assert not list(tmp_path.rglob("*.nbi"))
