"""`scripts/bootstrap.sh` says first what it costs, then how far it is; pip is a stand-in here."""

import os
import pty
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COSTS = (
    "bootstrap: this downloads up to 410 MB and takes up to 1.5 GB in .venv, and 2 to 10 minutes"
)
# It begins with two packages, waits until it may go on, and ends as pip does without a network.
PIP = """
printf 'Collecting one==1 (from -r %s)\\nCollecting two==2\\n' "$2" >"$3"
read -r _ <allowed
printf '%s: no network\\n' "$2" >&2
exit 1
"""

pytestmark = pytest.mark.slow  # a virtual environment is made


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "ros2_ws").mkdir()
    (tmp_path / "scripts").mkdir()
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    shutil.copy(ROOT / "scripts" / "bootstrap.sh", tmp_path / "scripts")
    (tmp_path / "scripts" / "install.sh").write_text(PIP)
    os.mkfifo(tmp_path / "allowed")
    return tmp_path


def started(checkout, stderr):
    kept = {name: value for name, value in os.environ.items() if name != "ROS_DISTRO"}
    return subprocess.Popen(
        ["bash", "scripts/bootstrap.sh"],
        cwd=checkout,
        env={**kept, "PYTHON": sys.executable},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=stderr,
    )


def test_in_an_image_there_is_nothing_to_install(checkout):
    shutil.rmtree(checkout / "requirements")
    process = started(checkout, subprocess.PIPE)
    (line,) = process.communicate()[1].decode().splitlines()
    assert process.returncode == 1
    assert line.startswith("bootstrap: nothing is installed in an image (")
    assert line.endswith("): run trunk and ros2, without scripts/")


def test_a_terminal_shows_the_cost_first_and_then_how_far_it_is(checkout):
    terminal, theirs = pty.openpty()
    process = started(checkout, theirs)
    os.close(theirs)
    shown = b""
    while b": 2 of 1 packages" not in shown:  # the stand-in says two, whatever the list
        shown += os.read(terminal, 1000)
    (checkout / "allowed").write_text("\n")
    try:
        while more := os.read(terminal, 1000):
            shown += more
    except OSError:  # everybody has closed it
        pass
    assert process.wait() == 1
    os.close(terminal)
    left = re.sub(r"[^\n]*\r\x1b\[K", "", shown.decode().replace("\r\n", "\n"))
    cost, making, *lists = left.splitlines()
    assert cost == COSTS
    assert making.startswith("bootstrap: making .venv with cpython 3.1")
    assert lists == [
        "bootstrap: installing requirements/setuptools.txt (1 of 6)",
        "bootstrap: requirements/setuptools.txt: no network",
    ]
