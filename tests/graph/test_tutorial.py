"""docs/tutorial.md: its commands, word for word and in order, in an empty folder."""

from __future__ import annotations

import os
import re
import signal
from contextlib import closing
from pathlib import Path

import pytest

from .peer import Peer
from .processes import Children, until

pytestmark = [pytest.mark.graph, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorial.md"
SAID = ("first.mcap: verified", "identical: 10006 messages, bit for bit")  # as the page prints


def commands() -> str:
    text = PAGE.read_text(encoding="utf-8")
    for line in SAID:
        assert f"    {line}\n" in text
    return "".join(re.findall(r"^```bash\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


def live_pid(children: Children) -> int:
    """Wait until `trunk live` runs, and return its process."""

    def found() -> list[int]:
        return [pid for pid, line in children.pids().items() if " live demo " in f"{line} "]

    return int(until(found, "trunk live")[0])


def test_the_commands_work_as_printed(
    children: Children, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "biped-trunk").symlink_to(ROOT)
    script = tmp_path / "page.sh"
    script.write_text(f"set -e\n{commands()}", encoding="utf-8")
    monkeypatch.setenv("BROWSER", "true")  # for a user a browser opens; here none does
    shell = children.start("page", "bash", script)
    until(
        lambda: "to watch only: http" in shell.stdout or shell.process.poll() is not None,
        "the live page",
    )
    with closing(Peer()) as peer:  # not before: the run in lock-step is over
        peer.until_started(shell)
        peer.until_recorded(200, "recorder")
    os.kill(live_pid(children), signal.SIGINT)
    assert shell.wait() == 0, shell.stdout + shell.stderr
    folder = tmp_path / "tutorial"
    for line in SAID:
        assert line in shell.stdout
    made = {path.name for path in folder.iterdir()}
    assert {"first.html", "rules.mcap", "rules.html", "own.mcap", "study.parquet"} <= made
    assert shell.stdout.count(": verified\n") == 2
