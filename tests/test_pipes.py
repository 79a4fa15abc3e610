"""A named pipe in place of a file is refused at once: reading it would wait for a writer for ever."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

VERBS = (
    ("info", "PIPE"),
    ("verify", "PIPE"),
    ("diff", "PIPE", "PIPE"),
    ("branch", "PIPE", "--at", "1", "-o", "branch.mcap"),
    ("study", "compare", "PIPE"),
    ("sweep", "PIPE", "-o", "sweep.parquet"),
    ("import", "fuzzy", "PIPE", "-o", "rules.yaml"),
    ("simulate", "demo", "--controller", "pid", "--params", "PIPE", "-o", "run.mcap"),
)


@pytest.mark.parametrize("words", VERBS, ids=lambda words: words[0])
def test_a_pipe_is_refused(
    trunk: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.fis")
    code, _, err = trunk(*("pipe.fis" if word == "PIPE" else word for word in words))
    assert code == 2
    assert err.startswith("trunk: error: ")
    assert "pipe.fis" in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.fis"]
