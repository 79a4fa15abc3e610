"""docs/export_c.md: its commands, word for word."""

import re
import shutil
from pathlib import Path

import pytest

from ..finished import finished

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "export_c.md").read_text()
EQUAL = "2001 of 2001 commands equal"
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE, re.S)


def run(block, folder):
    words = ["bash", "-euo", "pipefail", "-c", block]
    done = finished(words, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    (folder / "examples").symlink_to(ROOT / "examples")
    assert "tuned.mcap: verified" in run(BLOCKS[0], folder)
    return folder


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_the_examples_are_copied_with_a_controller(exported):
    run(BLOCKS[3], exported)
    for example in ("arduino", "plugin"):
        assert (exported / "c" / example / "controller.h").exists()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler: apt-get install gcc")
def test_on_this_machine(exported):
    assert EQUAL in PAGE
    assert EQUAL in run(BLOCKS[1], exported)


@pytest.mark.slow
@pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="no Arm tools: scripts/arm_tools.sh",
)
def test_on_a_cortex_m4(exported):
    assert EQUAL in run(BLOCKS[2], exported)
