"""docs/api.md: its code runs as printed, a type checker passes it; tests/inventory has the contract."""

import re
import sys
from pathlib import Path

import pytest

import trunk_experiments.api as trunk

from .finished import finished
from .inventory.__main__ import PLACE, library

PAGE = Path(__file__).parents[1] / "docs" / "api.md"
BLOCKS = re.findall(
    r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
)
SCRIPT = "".join(BLOCKS)
CHANGED = (
    "the public names or signatures of trunk_experiments.api are not those in tests/inventory. If that is "
    "intended: run python -m tests.inventory write, and tell users in CHANGELOG.md"
)


def test_the_contract_is_the_checked_in_list():
    listed = PLACE.read_text(encoding="utf-8")
    assert "".join(f"{line}\n" for line in library(trunk)) in listed, CHANGED
    assert listed.count("library trunk_experiments.api.") == len(trunk.__all__), CHANGED
    assert [name for name in {*trunk.__all__} - {"UNITS"} if not getattr(trunk, name).__doc__] == []


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_the_pages_code_runs_as_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(SCRIPT, str(PAGE), "exec"), {"__name__": "docs"})
    told = capsys.readouterr().out
    for printed in re.findall(r"print\(.*\)  # (.+)$", SCRIPT, re.MULTILINE):
        pattern = ".*".join(map(re.escape, printed.split("...")))
        assert printed.startswith("a table") or re.search(pattern, told), printed
    assert {path.name for path in tmp_path.iterdir()} == {"mine.mcap", "fig8.png", "branch.html"}


MISUSE = """
run.theta.nothing
trunk.plan(8)
trunk.metrics(run).iae + "text"
trunk.plot(run, figure=8)
plan.scenario = "fig7"
"""


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_a_strict_type_checker_sees_the_types_of_a_users_script(tmp_path):
    """With nothing but what `source scripts/env.sh` sets: the packages bring their types (py.typed)."""
    script = tmp_path / "script.py"
    script.write_text(f"{SCRIPT}\nreveal_type(run.theta)\nreveal_type(results.compare())\n{MISUSE}")
    done = finished(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), script.name],
        cwd=tmp_path,
    )
    lines = done.stdout.splitlines()
    revealed = [line for line in lines if "Revealed type" in line]
    assert "float64" in revealed[0]
    assert "PairedDifference" in revealed[1]
    first = script.read_text().count("\n", 0, script.read_text().index(MISUSE)) + 2
    found = {int(line.split(":")[1]) for line in lines if ": error:" in line}
    assert found == set(range(first, first + 5)), done.stdout + done.stderr
