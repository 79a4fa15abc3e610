import os
from pathlib import Path

import pytest

from trunk_core.files import atomic_write, will_write


def test_a_file_gets_its_name_when_complete(tmp_path):
    path = tmp_path / "a.txt"
    with atomic_write(path) as part:
        part.write_text("new")
        assert part.suffix == ".txt"  # writers go by it
        assert not path.exists()
    assert path.read_text() == "new"
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, OSError])
def test_an_existing_file_survives_a_failure(tmp_path, error):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail() -> None:
        with atomic_write(path) as part:
            part.write_text("half")
            raise error("stop")

    with pytest.raises(error):
        fail()
    assert path.read_text() == "old"
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]


def test_errors_name_the_file_that_was_asked_for(tmp_path):
    path = tmp_path / "missing" / "a.txt"
    with pytest.raises(FileNotFoundError) as raised, atomic_write(path) as part:
        part.write_text("new")
    assert raised.value.filename == str(path)
    with pytest.raises(FileNotFoundError) as raised, atomic_write(tmp_path / "b") as part:
        (tmp_path / "input").read_text()
    assert raised.value.filename == str(tmp_path / "input")


def test_a_device_that_is_full_is_named_and_left(tmp_path):
    path = tmp_path / "a.csv"
    path.symlink_to("/dev/full")
    with (
        pytest.raises(OSError, match="No space left on device") as raised,
        atomic_write(path) as part,
    ):
        part.write_text("new")
    assert raised.value.filename == str(path)
    assert path.is_symlink()


def test_an_existing_file_is_replaced_only_if_asked(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    refused = pytest.raises(FileExistsError, match="choose another name")
    with refused, atomic_write(path, overwrite=False):
        pytest.fail("must not be reached")


@pytest.mark.parametrize("links", [True, False], ids=["links", "no links"])
@pytest.mark.parametrize("told", [True, False], ids=["told before", "told"])
def test_what_another_wrote_meanwhile_stays(told, links, tmp_path, monkeypatch):
    def refused(*_: object) -> None:
        raise PermissionError

    if not links:  # FAT
        monkeypatch.setattr(os, "link", refused)
    path = tmp_path / "a.txt"
    if told:
        will_write(path, overwrite=False)
    kept = tmp_path / f"a.{os.getpid()}.txt"

    def write() -> None:
        with atomic_write(path, overwrite=None if told else False) as part:
            part.write_text("ours")
            path.write_text("theirs")

    with pytest.raises(OSError, match=f"^{path}: another command has written it .* is in {kept}$"):
        write()
    assert {each: each.read_text() for each in tmp_path.iterdir()} == {path: "theirs", kept: "ours"}
    will_write(path, overwrite=True)
    with atomic_write(path) as part:
        part.write_text("again")
    assert path.read_text() == "again"


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target.txt").write_text("old")
    link = tmp_path / "link.txt"
    link.symlink_to("target.txt")
    with atomic_write(link) as part:
        part.write_text("new")
    assert link.is_symlink()
    assert (tmp_path / "target.txt").read_text() == "new"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_device_is_written_to_directly():
    with atomic_write(Path("/dev/null")) as part:
        assert part == Path("/dev/null")
    with pytest.raises(OSError, match="No space"), atomic_write(Path("/dev/full")) as part:
        part.write_text("new")
    assert Path("/dev/full").is_char_device()
