"""docs/rules.md: its commands, word for word and in order, with an imported controller."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .processes import Children

pytestmark = [pytest.mark.graph, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "rules.md"


def test_the_commands_work_as_printed(children: Children, tmp_path: Path) -> None:
    pytest.importorskip("fuzzylite", reason="needs pyfuzzylite: requirements/fuzzy.txt")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    text = PAGE.read_text(encoding="utf-8")
    commands = "".join(re.findall(r"^```bash\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    script = tmp_path / "page.sh"
    script.write_text(f"set -e\ncd {tmp_path}\n{commands}", encoding="utf-8")
    shell = children.start("page", "bash", script)
    assert shell.wait() == 0, shell.stdout + shell.stderr
    (said,) = re.findall(r"^    (examples/rules/.* sampled: .*)$", text, re.MULTILINE)
    assert said in shell.stdout
    assert shell.stdout.count(": verified\n") == 2
    assert "identical: " in shell.stdout
    assert (tmp_path / "again.yaml").read_text() == (tmp_path / "rules.yaml").read_text()
