"""docs/parameters.md: the files and commands in two of its sections work word for word."""

import re
from pathlib import Path

import pytest

from trunk_control.rule_tables import Axes
from trunk_core.parameters.parameter_files import ParameterFileError
from trunk_runs.plan import make_plan

from .finished import finished

PAGE = (Path(__file__).parents[1] / "docs" / "parameters.md").read_text(encoding="utf-8")
SERIES, RULES = (
    "".join(re.findall(rf"## {title}.*?(?=\n## )", PAGE, re.DOTALL))
    for title in ("A reference and a disturbance of your own", "Rule tables")
)


def block(section: str, language: str) -> str:
    (text,) = re.findall(rf"```{language}\n(.*?)```", section, re.DOTALL)
    return text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("section", "says"),
    [(SERIES, "lean.mcap: verified"), (RULES, "cell_surface.png: 1 run")],
    ids=["series", "rules"],
)
def test_the_commands_work(section, says, tmp_path):
    done = finished(["bash", "-euc", block(section, "bash")], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert says in done.stdout


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written = re.findall(r"cat > (\S+) <<'END'\n(.*?)END\n", block(SERIES, "bash"), re.DOTALL)
    for name, text in (*written, ("mine.yaml", block(SERIES, "yaml"))):
        Path(name).write_text(text)


@pytest.mark.usefixtures("files")
def test_the_parameter_file_is_accepted():
    plan = make_plan("demo", "pid", ["mine.yaml"])
    assert plan.controller.reference_profile == "sequence"
    assert plan.disturbance.table_times == (4.0, 4.1, 4.3)
    assert len(plan.disturbance.signals.pulse_starts) == 5
    assert plan.warnings == ()


@pytest.mark.usefixtures("files")
def test_the_mistake_reads_as_printed():
    Path("lean.csv").write_text(Path("lean.csv").read_text().replace("\n3,20", "\n3,0\n2.5,20"))
    (printed,) = re.findall(r"    trunk: error: (.*)", SERIES)
    settings = ["pid.reference.profile=interpolated", "pid.reference.file=lean.csv"]
    with pytest.raises(ParameterFileError) as caught:
        make_plan("demo", "pid", settings=settings)
    assert str(caught.value) == printed


def test_the_rule_base_is_accepted(tmp_path):
    path = tmp_path / "rules.yaml"
    path.write_text(block(RULES, "yaml"))
    config = make_plan("demo", "fuzzy", [str(path)]).controller
    assert config.axes == Axes(("NB", "NS", "ZO", "PS", "PB"), ("N", "ZO", "P"))
    assert config.inference(0.0, 0.0) == (0.0,)
    assert config.inference(9.0, 9.0) == (1.0,)
