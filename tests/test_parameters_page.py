"""docs/parameters.md: the CSV files and commands in it work word for word."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_msgs_util.parameters.files import ParameterFileError

PAGE = (Path(__file__).parents[1] / "docs" / "parameters.md").read_text(encoding="utf-8")
(SECTION,) = re.findall(
    r"## A reference and a disturbance of your own.*?(?=\n## )", PAGE, re.DOTALL
)


def block(language: str) -> str:
    (found,) = re.findall(rf"```{language}\n(.*?)```", SECTION, re.DOTALL)
    return found


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in re.findall(r"cat > (\S+) <<'END'\n(.*?)END\n", block("bash"), re.DOTALL):
        Path(name).write_text(text)
    Path("mine.yaml").write_text(block("yaml"))
    return tmp_path


@pytest.mark.slow
def test_the_commands_make_a_verified_run(tmp_path):
    done = subprocess.run(
        ["bash", "-euc", block("bash")], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "lean.mcap: verified" in done.stdout


def test_the_parameter_file_is_accepted(files):
    plan = make_plan("demo", "pid", ["mine.yaml"])
    assert plan.controller.reference_profile == "sequence"
    assert plan.disturbance.table_times == (4.0, 4.1, 4.3)
    assert len(plan.disturbance.signals.pulse_starts) == 5
    assert plan.warnings == ()


def test_the_mistake_reads_as_printed(files):
    Path("lean.csv").write_text(Path("lean.csv").read_text().replace("\n3,20", "\n3,0\n2.5,20"))
    (printed,) = re.findall(r"    trunk: error: (.*)", SECTION)
    settings = ["pid.reference.profile=file", "pid.reference.file=lean.csv"]
    with pytest.raises(ParameterFileError) as caught:
        make_plan("demo", "pid", settings=settings)
    assert str(caught.value) == printed
