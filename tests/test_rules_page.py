"""The rule tables of docs/parameters.md: its file is accepted, its commands work."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from trunk_control.rule_tables import Axes
from trunk_experiments.plans.plan import make_plan

PAGE = (Path(__file__).parents[1] / "docs" / "parameters.md").read_text(encoding="utf-8")
(SECTION,) = re.findall(r"## Rule tables.*?(?=\n## )", PAGE, re.DOTALL)


def block(language: str) -> str:
    (text,) = re.findall(rf"```{language}\n(.*?)```", SECTION, re.DOTALL)
    return text


def test_the_rule_base_is_accepted(tmp_path):
    path = tmp_path / "rules.yaml"
    path.write_text(block("yaml"))
    config = make_plan("demo", "fuzzy", [str(path)]).controller
    assert config.axes == Axes(("NB", "NS", "ZO", "PS", "PB"), ("N", "ZO", "P"))
    assert config.inference(0.0, 0.0) == (0.0,)
    assert config.inference(9.0, 9.0) == (1.0,)


@pytest.mark.slow
def test_the_commands_work(tmp_path):
    done = subprocess.run(
        ["bash", "-euc", block("bash")], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "cell_surface.png: 1 run" in done.stdout
