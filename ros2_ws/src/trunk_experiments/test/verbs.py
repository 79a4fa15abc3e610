"""Every verb with sound arguments, in a folder with a file of each kind."""

import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

from trunk_experiments.cli import main
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

Arguments = tuple[object, ...]


class Verb(NamedTuple):
    """A verb, its inputs, and the suffix of what it writes; empty if it writes nothing."""

    words: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    suffix: str = ""

    @property
    def sound(self) -> tuple[str, ...]:
        """A sound command."""
        output = ("-o", f"made{self.suffix}") if self.suffix else ()
        return (*self.words, *self.inputs, *output)

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
    Verb(("info",), ("a.mcap",)),
    Verb(("list", "runs"), ("runs",)),
    Verb(("list", "scenarios")),
    Verb(("list", "controllers")),
    Verb(("info", "--check"), ("a.mcap",)),
    Verb(("recover",), ("a.mcap",), ".mcap"),
    Verb(("export", "-o", "made.csv"), ("a.mcap",)),
    Verb(("rules", "write"), (), ".fis"),
    Verb(("export-c", "-o", "c"), ("pid",)),
    Verb(("lab", "fig8", "--duration", "0.1"), (), ".html"),
    Verb(("rules", "read"), ("rules.fll",), ".yaml"),
    Verb(("params", "pid")),
    Verb(("params", "apply"), ("params.yaml",)),
    Verb(("params", "show"), ("fuzzy_zhao_1993",)),
    Verb(("params", "set"), ("pid", "gains.p=4")),
    Verb(("sweep", "--jobs", "1"), ("study.yaml",), ".parquet"),
    Verb(("study", "compare"), ("swept.parquet",)),
    Verb(("study", "report", "--no-floquet"), ("swept.parquet",), ".html"),
    Verb(("sweep", "--sobol", "2", "--jobs", "1"), ("drawn.yaml",)),
    Verb(("study", "show", "--run", "1"), ("swept.parquet",), ".mcap"),
    Verb(("study", "map", "--no-floquet"), ("swept.parquet",), ".png"),
    Verb(("paper", "-o", "made")),
    Verb(("tune", "poles"), (), ".yaml"),
    Verb(("tune", "lqr"), (), ".yaml"),
    Verb(("tune", "optimise", "--generations", "1", "--population", "2"), (), ".yaml"),
    Verb(("run",), ("demo", "--lockstep", "--composed", "--duration", "0.05")),
)


def of_recording(path: Path, base: Path, folder: Path) -> Mapping[str, Arguments]:
    """Return the verbs that read a recording; ``base`` is a sound one to compare it with."""
    return {
        "info": ("info", path),
        "info --json": ("info", "--json", path),
        "metrics": ("metrics", path),
        "metrics --json": ("metrics", "--json", path),
        "verify": ("verify", path),
        "explain": ("explain", path, "--at", "0.5"),
        "plot": ("plot", path, "-o", folder / "a.png", "--force"),
        "report": ("report", path, "-o", folder / "a.html", "--force"),
        "info --check": ("info", "--check", path),
        "export": (
            *("export", path, "-o", folder / "a.csv", "-o", folder / "a.npz"),
            *("-o", folder / "a.parquet", "--force"),
        ),
        "export mcap": ("export", path, "-o", folder / "a.mcap", "--force"),
        "diff, first": ("diff", path, base),
        "diff, second": ("diff", base, path),
        "compare, first": ("compare", path, base),
        "compare, second": ("compare", "--json", base, path),
        "recover": ("recover", path, "-o", folder / "b.mcap", "--force"),
        "simulate --like": ("simulate", "--like", path, "-o", folder / "c.mcap", "--force"),
    }


def of_text(path: Path, text: str, folder: Path) -> Mapping[str, Arguments]:
    """Return the verbs that read a YAML file."""
    plan = ("-o", folder / "a.yaml", "--force")
    return {
        "plan --params": ("plan", "fig6", "--params", path, *plan),
        "plan": ("plan", path, *plan),
        "plan --set": ("plan", "fig6", "--set", f"pid.kp={text[:100_000]}", *plan),
        "simulate": ("simulate", path, "-o", folder / "a.mcap", "--force", "--duration", "0.1"),
        "sweep": ("sweep", path, "-o", folder / "a.parquet", "--force"),
    }


DRAWN = """
scenario: fig6
rate: 100
duration: 0.2
controllers: [pid]
vary:
  angle: {parameter: "simulator.initial.position[1]", distribution: uniform, low: 0.1, high: 0.4}
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.4, high: 0.6}
"""
STUDY = """
scenario: fig6
params: profile_practical
rate: 200
duration: 2.5
controllers: [pid, lqr]
set: {simulator.hip.mode: prescribed, simulator.path.amplitude: 0.03}
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.3]}
  gain: {parameter: pid.gains.p, as: factor, values: [1.0, 1.5]}
"""


def furnish(folder: Path) -> Path:
    """Put sound files of each kind into a folder, and others that are not what their names say."""
    for name, scenario, controller in (
        ("a", "fig8", "pid"),
        ("b", "fig8", "fuzzy_pid"),
        ("sound", "fig6", "lqr"),
    ):
        plan = make_plan(scenario, controller, settings=["simulator.duration=1.3"])
        record_offline(plan, folder / f"{name}.mcap")
    (folder / "study.yaml").write_text(STUDY)
    (folder / "drawn.yaml").write_text(DRAWN)
    sound = (folder / "a.mcap").read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in (
            "plan demo -o params.yaml",
            "report a.mcap -o page.html",
            "plot a.mcap -o picture.png",
            "export a.mcap -o table.csv",
            "sweep study.yaml -o swept.parquet",
            "rules write -o rules.fll",
        ):
            patch.setattr(sys, "argv", ["trunk", *words.split()])
            with pytest.raises(SystemExit) as end:
                main()
            assert not end.value.code, words
    for name, content in {
        "empty.mcap": b"",
        "broken.mcap": b"this is text\n",
        "cut.mcap": sound[:-40_000],
        "picture.mcap": (folder / "picture.png").read_bytes(),
        "yaml.mcap": (folder / "params.yaml").read_bytes(),
        "parquet.mcap": (folder / "swept.parquet").read_bytes(),
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
    return folder
