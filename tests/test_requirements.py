"""Locks are complete, and only what they name with its hash gets installed."""

from __future__ import annotations

import hashlib
import os
import re
import sys
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from .finished import finished

ROOT = Path(__file__).parents[1]
LOCKS = sorted((ROOT / "requirements").glob("*.txt"))
INSTALL = ROOT / "scripts" / "install.sh"
HASH = r"--hash=sha256:[0-9a-f]{64}"


def entries(text):
    """Return the requirements of a lock, each with its hashes, as logical lines."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line for line in lines if not line.startswith("#")]


def wanted(file):
    """Return the requirements of a *.in file and of those that it includes."""
    found = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.startswith("-r "):
            found += wanted(file.parent / line.removeprefix("-r "))
        elif line and not line.startswith("#"):
            found.append(Requirement(line))
    return found


def pinned(text):
    """Return name -> version of a lock."""
    found = {}
    for line in entries(text):
        requirement = Requirement(line.split(" --hash")[0])
        found[canonicalize_name(requirement.name)] = str(requirement.specifier)[2:]
    return found


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_every_line_of_a_lock_is_one_version_with_hashes_and_no_index(lock):
    for line in entries(lock.read_text(encoding="utf-8")):
        assert re.fullmatch(rf"[a-z0-9-]+==[\w.]+( ; [^-#]+)?(\s+{HASH})+", line), line


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_what_a_person_asks_for_is_in_its_lock(lock):
    versions = pinned(lock.read_text(encoding="utf-8"))
    for requirement in wanted(lock.with_suffix(".in")):
        name = canonicalize_name(requirement.name)
        assert name in versions, "run scripts/lock.sh"
        assert requirement.specifier.contains(versions[name]), "run scripts/lock.sh"


def test_each_list_has_a_lock_and_lock_sh_renews_it():
    lists = {file.stem for file in (ROOT / "requirements").glob("*.in")}
    assert lists == {file.stem for file in LOCKS}
    sets = re.search(r"^sets=\((.*)\)", (ROOT / "scripts/lock.sh").read_text(), re.MULTILINE)
    assert {*sets[1].split(), "fuzzy", "bench", "cuda12", "cuda13"} == lists


def test_one_version_of_a_package_in_all_locks():
    versions = {}
    locks = {lock: pinned(lock.read_text(encoding="utf-8")) for lock in LOCKS}
    other = locks.pop(ROOT / "requirements" / "cuda13.txt")  # instead of cuda12.txt
    assert {"numpy": other.pop("numpy")}.items() <= locks[ROOT / "requirements/runtime.txt"].items()
    for lock, packages in locks.items():
        for name, version in packages.items():
            assert versions.setdefault(name, version) == version, f"{name} in {lock.name}"


def test_only_install_sh_calls_pip_install():
    files = [*ROOT.glob("scripts/*.sh"), ROOT / "docker" / "Dockerfile", ROOT / ".ci" / "run"]
    calls = {
        file.name
        for file in files
        for line in file.read_text(encoding="utf-8").splitlines()
        if "pip install" in line and not line.lstrip().startswith("#") and "sed -i" not in line
    }
    assert calls == {"install.sh"}


def test_beside_ros_from_apt_numpy_is_left_out_with_all_its_hashes():
    program = re.search(r"sed '(/\^numpy==.*?)'", (ROOT / "scripts/bootstrap.sh").read_text())[1]
    lock = ROOT / "requirements" / "runtime.txt"
    left = finished(["sed", program, lock], check=True).stdout
    text = lock.read_text(encoding="utf-8")
    assert entries(left) == [line for line in entries(text) if not line.startswith("numpy==")]
    assert len(entries(left)) == len(entries(text)) - 1


@pytest.fixture
def wheel(tmp_path):
    """A package for pip that needs another one, which does not exist."""
    file = tmp_path / "index" / "tiny_thing-1.0-py3-none-any.whl"
    file.parent.mkdir()
    about = "tiny_thing-1.0.dist-info"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("tiny_thing.py", "")
        archive.writestr(
            f"{about}/METADATA",
            "Metadata-Version: 2.1\nName: tiny-thing\nVersion: 1.0\nRequires-Dist: nowhere-at-all\n",
        )
        archive.writestr(
            f"{about}/WHEEL",
            "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        archive.writestr(f"{about}/RECORD", "")
    return file


def install(wheel, requirement):
    """Run install.sh for one line, without a network; return its exit code, lines and target."""
    folder = wheel.parents[1]
    (folder / "some.txt").write_text(f"{requirement}\n")
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    here = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheel.parent), "PIP_CONFIG_FILE": os.devnull}
    done = finished(
        ["bash", INSTALL, sys.executable, "some.txt", "log", "--target", "target"],
        cwd=folder,
        env=kept | here,
    )
    return done.returncode, (done.stdout + done.stderr).splitlines(), folder / "target"


@pytest.mark.slow
def test_a_package_with_its_hash_is_installed_without_dependencies(wheel):
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    code, lines, target = install(wheel, f"tiny-thing==1.0 --hash=sha256:{digest}")
    assert (code, lines) == (0, [])
    assert (target / "tiny_thing.py").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("digest", "says"),
    [
        (
            f" --hash=sha256:{'0' * 64}",
            "some.txt: tiny-thing==1.0: what was downloaded has none of",
        ),
        ("", "some.txt: tiny-thing==1.0: this file has no hash for it"),
    ],
    ids=["altered", "absent"],
)
def test_a_package_without_its_hash_is_refused_in_one_line(wheel, digest, says):
    code, lines, target = install(wheel, f"tiny-thing==1.0{digest}")
    assert code == 1
    assert len(lines) == 1
    assert lines[0].startswith(says)
    assert "scripts/lock.sh" in lines[0]
    assert not target.exists()


@pytest.mark.slow
def test_no_code_of_a_source_package_is_run(wheel):
    """Its hash is right, but setup.py would be run, with whatever it needs to build."""
    source = wheel.with_name("tiny_thing-1.0.tar.gz")
    source.write_bytes(b"not even an archive: it must not be opened")
    wheel.unlink()
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    code, lines, target = install(wheel, f"tiny-thing==1.0 --hash=sha256:{digest}")
    assert code == 1
    assert len(lines) == 1
    assert "could not be installed: ERROR: Could not find a version" in lines[0]
    assert not target.exists()
