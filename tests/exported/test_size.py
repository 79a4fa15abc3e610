"""Sizes on a Cortex-M4: text with tables, and the deepest stack of an update; libgcc apart."""

import re
import shutil
import subprocess
from functools import cache

import pytest

from trunk_control.laws import law_named
from trunk_experiments.export_c.library import ExportedController, header, source
from trunk_runs.nodes import CONTROLLERS

from ..finished import finished

pytestmark = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None, reason="no Arm tools: scripts/arm_tools.sh"
)


def deepest(graph, begin):
    """Return the bytes of the deepest path of calls that GCC's -fcallgraph-info=su knows."""
    bytes_of = dict(
        re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \(static\)', graph)
    )
    calls = re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', graph)

    @cache
    def depth(name):
        below = [depth(target) for source, target in calls if source == name]
        return int(bytes_of.get(name, 0)) + max(below, default=0)

    return depth(begin)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_small_enough_for_a_cortex_m4(name, tmp_path):
    law = law_named(name)
    exported = ExportedController(law, law.config())
    (tmp_path / f"{name}.h").write_text(header(exported))
    (tmp_path / f"{name}.c").write_text(source(exported))
    flags = "-std=c99 -Os -mcpu=cortex-m4 -mthumb -ffreestanding -fcallgraph-info=su -c"
    subprocess.run(["arm-none-eabi-gcc", *flags.split(), f"{name}.c"], cwd=tmp_path, check=True)
    words = ["arm-none-eabi-size", f"{name}.o"]
    out = finished(words, cwd=tmp_path, check=True)
    text, data = map(int, out.stdout.splitlines()[1].split()[:2])
    graph = (tmp_path / f"{name}.ci").read_text()
    stack = deepest(graph, f"{name}_update")
    print(name, text, stack)
    assert data == 0
    assert text <= 11_264
    assert 100 < stack <= 2048
