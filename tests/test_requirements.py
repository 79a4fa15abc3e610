"""Locks are complete, and only what they name with its hash gets installed."""

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
def test_a_lock_has_one_version_with_hashes_of_whatever_a_person_asks_for(lock):
    text = lock.read_text(encoding="utf-8")
    for line in entries(text):  # and names no index
        assert re.fullmatch(rf"[a-z0-9-]+==[\w.]+( ; [^-#]+)?(\s+{HASH})+", line), line
    versions = pinned(text)
    for requirement in wanted(lock.with_suffix(".in")):
        name = canonicalize_name(requirement.name)
        assert name in versions, "run scripts/lock.sh"
        assert requirement.specifier.contains(versions[name]), "run scripts/lock.sh"


def test_one_version_of_a_package_in_all_locks():
    versions = {}
    for lock in LOCKS:
        for name, version in pinned(lock.read_text(encoding="utf-8")).items():
            known = versions.setdefault(name, version)
            # cuda13.txt is installed instead of cuda12.txt, beside the same runtime.txt.
            assert version == known or (lock.stem == "cuda13" and name != "numpy"), (
                name,
                lock.name,
            )


def test_only_install_sh_calls_pip_install():
    calls = re.compile(r"^(?!\s*#|.*sed -i).*pip install", re.MULTILINE)
    files = [*ROOT.glob("scripts/*.sh"), ROOT / "docker" / "Dockerfile"]
    assert [file.name for file in files if calls.search(file.read_text("utf-8"))] == ["install.sh"]


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
        (f" --hash=sha256:{'0' * 64}", "what was downloaded has none of"),
        ("", "this file has no hash for it"),
    ],
    ids=["altered", "absent"],
)
def test_a_package_without_its_hash_is_refused_in_one_line(wheel, digest, says):
    code, (line,), target = install(wheel, f"tiny-thing==1.0{digest}")
    assert code == 1
    assert line.startswith(f"some.txt: tiny-thing==1.0: {says}")
    assert "scripts/lock.sh" in line
    assert not target.exists()


@pytest.mark.slow
def test_no_code_of_a_source_package_is_run(wheel):
    """Its hash is right, but setup.py would be run, with whatever it needs to build."""
    source = wheel.with_name("tiny_thing-1.0.tar.gz")
    source.write_bytes(b"not even an archive: it must not be opened")
    wheel.unlink()
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    code, (line,), target = install(wheel, f"tiny-thing==1.0 --hash=sha256:{digest}")
    assert code == 1
    assert "could not be installed: ERROR: Could not find a version" in line
    assert not target.exists()
