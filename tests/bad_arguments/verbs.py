"""Every verb with sound arguments, in a folder with a file of each kind."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import NamedTuple

from trunk_experiments.cli import main
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.offline_recording import record_offline


class Verb(NamedTuple):
    """A verb, its inputs, and the suffix of what it writes; empty if it writes nothing."""

    words: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    suffix: str = ""

    @property
    def name(self) -> str:
        """The verb as typed."""
        return " ".join(self.words)


VERBS = (
    Verb(("simulate",), ("demo",), ".mcap"),
    Verb(("branch", "--at", "0.1"), ("a.mcap",), ".mcap"),
    Verb(("plan",), ("demo",), ".yaml"),
    Verb(("metrics",), ("a.mcap",)),
    Verb(("report",), ("a.mcap",), ".html"),
    Verb(("compare",), ("a.mcap", "b.mcap")),
    Verb(("explain", "--at", "0.2"), ("a.mcap",)),
    Verb(("plot",), ("a.mcap",), ".png"),
    Verb(("diff",), ("a.mcap", "b.mcap")),
    Verb(("verify",), ("a.mcap",)),
    Verb(("sign",), ("a.mcap",), ".sig"),
    Verb(("info",), ("a.mcap",)),
    Verb(("list", "runs"), ("runs",)),
    Verb(("list", "scenarios")),
    Verb(("list", "controllers")),
    Verb(("doctor",), ("a.mcap",)),
    Verb(("recover",), ("a.mcap",), ".mcap"),
    Verb(("export",), ("a.mcap",), ".csv"),
    Verb(("export", "fuzzy"), (), ".fis"),
    Verb(("export-c", "-o", "c"), ("pid",)),
    Verb(("export-web", "fig8", "--duration", "0.1"), (), ".html"),
    Verb(("import", "fuzzy"), ("rules.fll",), ".yaml"),
    Verb(("params", "pid")),
    Verb(("params", "apply"), ("params.yaml",)),
    Verb(("params", "show"), ("fuzzy_zhao_1993",)),
    Verb(("params", "set"), ("pid", "gains.p=4")),
    Verb(("sweep",), ("study.yaml",), ".parquet"),
    Verb(("study", "compare"), ("study.parquet",)),
    Verb(("study", "report"), ("study.parquet",), ".html"),
    Verb(("study", "sensitivity"), ("study.yaml",)),
    Verb(("study", "show", "--run", "1"), ("study.parquet",), ".mcap"),
    Verb(("study", "map"), ("study.parquet",), ".png"),
    Verb(("paper",), (), ".html"),
    Verb(("tune", "poles"), (), ".yaml"),
    Verb(("tune", "lqr"), (), ".yaml"),
    Verb(("tune", "optimise"), (), ".yaml"),
    Verb(("fit", "path", "--harmonics", "1"), ("gait.csv",), ".yaml"),
    Verb(("run",), ("demo", "--lockstep", "--composed", "--duration", "0.05")),
)

_STUDY = """\
scenario: demo
controllers: [pid, fuzzy_pid]
set: {simulator.duration: 0.2}
vary: {mass: {parameter: simulator.plant.trunk_mass, from: 0.4, to: 0.6, steps: 3},
       size: {parameter: simulator.plant.length, from: 0.9, to: 1.1, steps: 3}}
"""


def furnish(folder: Path) -> None:
    """Put sound files of each kind into a folder, and others that are not what their names say."""
    plan = make_plan("demo", "pid", settings=["simulator.duration=0.5"])
    record_offline(plan, folder / "a.mcap")
    record_offline(make_plan("demo", "lqr", settings=["simulator.duration=0.5"]), folder / "b.mcap")
    (folder / "study.yaml").write_text(_STUDY)
    (folder / "gait.csv").write_text("x,y\n0,0\n0.1,1\n0.2,0\n0.3,-1\n0.4,0\n")
    sound = (folder / "a.mcap").read_bytes()
    os.chdir(folder)
    for words in (
        ("plan", "demo", "-o", "params.yaml"),
        ("report", "a.mcap", "-o", "page.html"),
        ("plot", "a.mcap", "-o", "picture.png"),
        ("export", "a.mcap", "--csv", "table.csv"),
        ("sweep", "study.yaml", "-o", "study.parquet"),
        ("sign", "--new-key", "key.pem"),
        ("export", "fuzzy", "-o", "rules.fll"),
    ):
        called(words)
    for name, content in {
        "empty.mcap": b"",
        "text.mcap": b"this is text\n",
        "short.mcap": sound[: len(sound) // 2],
        "picture.mcap": (folder / "picture.png").read_bytes(),
        "yaml.mcap": (folder / "params.yaml").read_bytes(),
        "parquet.mcap": (folder / "study.parquet").read_bytes(),
        "pipe.json": b"{}",
        "bad.yaml": b"a: [1\n",
        **{f"kept{suffix}": b"kept" for suffix in {verb.suffix for verb in VERBS} - {""}},
    }.items():
        (folder / name).write_bytes(content)
    for name in ("folder", "hollow", "two", "runs"):
        (folder / name).mkdir()
    (folder / "folder" / "note.txt").write_text("kept")
    for name in ("a.mcap", "b.mcap"):
        shutil.copy(folder / name, folder / "two" / name)
    shutil.copy(folder / "a.mcap", folder / "runs" / "a.mcap")
    (folder / "loop").symlink_to("loop")
    (folder / "dangling").symlink_to("nowhere")


def called(words: tuple[str, ...]) -> int:
    """Call the command in this process; return its exit code."""
    import sys

    sys.argv = ["trunk", *words]
    try:
        main()
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
            return 1
        return end.code or 0
    return 0
