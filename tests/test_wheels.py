"""One version everywhere; wheels that declare what they need, and work without ROS and a checkout."""

import os
import re
import subprocess
import sys
import zipfile
from contextlib import ExitStack, suppress
from email.parser import Parser
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from trunk_core.errors import RunError
from trunk_runs.processes import claimed_domain

from .finished import finished

ROOT = Path(__file__).parents[1]
DOMAIN = str(101 + os.getpid() % 132)  # none that a test with nodes is in
PACKAGES = sorted(path.parent for path in ROOT.glob("ros2_ws/src/*/package.xml"))
NAMES = {path.name for path in PACKAGES}

# ROS 2 is not there, whatever the environment below has.
WITHOUT_ROS = """
import sys

class WithoutRos:
    def find_spec(self, name, path=None, target=None):
        top = name.split(".")[0]
        if top.startswith(("rcl", "rosidl", "launch")) or top.endswith(("_msgs", "_srvs")):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, WithoutRos())
"""


def project_version() -> str:
    script = ["bash", ROOT / "scripts" / "version.sh"]
    return finished(script, check=True).stdout.strip()


def test_one_version_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    found = {p.name: ElementTree.parse(p / "package.xml").findtext("version") for p in PACKAGES}
    found |= {f"installed {name}": version(name) for name in NAMES}
    found["CITATION.cff"] = citation["version"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found["CHANGELOG.md"] = re.findall(r"^## ([\d.]+) – \d{4}-\d\d-\d\d$", changes, re.MULTILINE)[0]
    assert found == dict.fromkeys(found, project_version()), "scripts/version.sh sets it"


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheels")
    subprocess.run(["bash", ROOT / "scripts" / "wheels.sh", folder], check=True)
    return folder


def installed(folder, files):
    """Return a Python outside the checkout in which wheels alone are installed.

    Libraries are those of this environment, so that no network is needed; ROS 2 is blocked.
    """
    python = folder / "venv" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet"]
    subprocess.run([*pip, "--no-index", "--no-deps", "--no-compile", *files], check=True)
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    (site / "zz_without_ros.py").write_text(WITHOUT_ROS)
    libraries = Path(yaml.__file__).parents[1]
    (site / "libraries.pth").write_text(f"{libraries}\nimport zz_without_ros\n")
    return python


@pytest.fixture(scope="module")
def trunk(wheels, tmp_path_factory):
    """Return a function that runs ``trunk`` with the wheels alone."""
    folder = tmp_path_factory.mktemp("empty")
    python = installed(folder, sorted(wheels.glob("*.whl")))

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        clean = {"PATH": os.defpath, "HOME": str(folder), "MPLBACKEND": "agg"}
        clean["ROS_DOMAIN_ID"] = DOMAIN
        command = [python.with_name("trunk"), *words]
        return finished(command, cwd=folder, env=clean)

    return run


@pytest.mark.slow
def test_wheels_declare_what_they_need(wheels):
    lock = (ROOT / "requirements" / "runtime.txt").read_text(encoding="utf-8")
    pins = dict(re.findall(r"^([a-z0-9-]+)==([\w.]+)", lock, re.MULTILINE))
    asked = set()
    for file in sorted(wheels.glob("*.whl")):
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
            (about,) = (n for n in names if n.endswith(".dist-info/METADATA"))
            metadata = Parser().parsestr(archive.read(about).decode())
        assert metadata["Version"] == project_version()
        assert metadata["License"] == "Apache-2.0"
        assert any(name.endswith("licenses/LICENSE") for name in names)
        assert not [name for name in names if "/test_" in name and name.endswith(".py")]
        for text in metadata.get_all("Requires-Dist", []):
            one = Requirement(text)
            if one.name in NAMES:
                assert str(one.specifier) == f"=={project_version()}"
            elif one.marker is None:
                asked.add(canonicalize_name(one.name))
                assert one.specifier.contains(pins[canonicalize_name(one.name)]), text
    wanted = (ROOT / "requirements" / "runtime.in").read_text(encoding="utf-8").splitlines()
    lines = [Requirement(line).name for line in wanted if line and not line.startswith("#")]
    assert asked == {canonicalize_name(name) for name in lines}


@pytest.mark.slow
def test_the_wheels_hold_all_data_of_the_packages(wheels):
    for package in PACKAGES:
        (file,) = wheels.glob(f"{package.name}-*.whl")
        with zipfile.ZipFile(file) as archive:
            held = set(archive.namelist())
        for path in (package / package.name).rglob("*"):
            name = path.relative_to(package).as_posix()
            if path.is_file() and "__pycache__" not in name:
                assert name in held, f"{name}: add it to package_data in setup.py"


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_the_wheels_alone_simulate_and_verify(trunk):
    assert trunk("--version").stdout == f"trunk {project_version()}\n"
    made = trunk("simulate", "fig6", "--controller", "fuzzy_pid", "-o", "run.mcap")
    assert made.returncode == 0, made.stderr
    verdict = trunk("verify", "run.mcap")
    assert (verdict.returncode, verdict.stdout.splitlines()[0]) == (0, "run.mcap: verified")
    assert re.search(r"^commit +none$", trunk("info", "run.mcap").stdout, re.MULTILINE)


TABLES = """
import sys
from trunk_recording.reader import Recording

recording = Recording.open(sys.argv[1])
joints = {name: None for name, topic in recording.topics.items() if "Joint" in topic.type}
print(sum(len(table.stamp_ns) for table in recording.tables(joints).values()))
print(*sorted({*sys.modules} & {*sys.argv[2:]}))
"""


@pytest.mark.slow
@pytest.mark.one_in(4)
def test_the_wheel_of_recordings_and_what_it_asks_for_read_any_file(wheels, tmp_path):
    """By the MCAP of another robot, as of our own runs."""
    (about,) = wheels.glob("trunk_recording-*.whl")
    with zipfile.ZipFile(about) as archive:
        (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(name).decode())
    ours = {r.name for r in map(Requirement, metadata.get_all("Requires-Dist", []))} & NAMES
    assert ours == {"trunk_core"}
    python = installed(tmp_path, [about, *(w for n in ours for w in wheels.glob(f"{n}-*.whl"))])
    for file in sorted((ROOT / "tests/archive").glob("*.mcap")):
        read = finished(
            [python, "-c", TABLES, file, *NAMES], cwd=tmp_path, check=True
        ).stdout.split()
        assert int(read[0]) > 0
        assert read[1:] == ["trunk_core", "trunk_recording"]


@pytest.mark.one_in(5)
@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("run", "fig6", "--controller", "pid", "--output", "run"),
        ("live", "--attach", "/", "--no-browser"),
        ("paper", "--graph", "--output", "paper"),
    ],
    ids=lambda words: words[0],
)
def test_a_verb_that_needs_ros_says_so_in_one_line(trunk, words, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", DOMAIN)
    with ExitStack() as held:
        with suppress(RunError):  # another run holds it already
            held.enter_context(claimed_domain())
        refused = trunk(*words)
    assert refused.returncode
    (line,) = (one for one in refused.stderr.splitlines() if "error" in one)
    assert "scripts/bootstrap.sh" in line
    assert "Traceback" not in refused.stderr
