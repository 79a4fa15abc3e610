"""Every verb that reads, with its arguments for one file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

Arguments = tuple[object, ...]


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
        "doctor": ("doctor", path),
        "export": (
            *("export", path, "--csv", folder / "a.csv", "--npz", folder / "a.npz"),
            *("--parquet", folder / "a.parquet", "--force"),
        ),
        "export --mcap": ("export", path, "--mcap", folder / "a.mcap", "--force"),
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
