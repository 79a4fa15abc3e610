"""How tests replay a run: step by step, or by stretches, which are not compiled for so few states."""

from __future__ import annotations

import pytest

from trunk_experiments.replay import replay, stretches

WAYS = ("step by step", "by stretches", "by windows")


def replay_this_way(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make all replays go this way."""
    if way == "by windows":
        monkeypatch.setattr(stretches, "LONGEST", 7)
    if way == "step by step":
        return
    monkeypatch.setattr(replay, "WORTH_COMPILING", 0)
    for name in ("plant", "disturbances"):
        function = getattr(stretches, f"{name}_stretch")
        monkeypatch.setattr(stretches, f"compiled_{name}", lambda function=function: function)
    monkeypatch.setattr(
        stretches,
        "compiled_commands",
        lambda law: stretches.commands_stretch_of(stretches.law_named(law)),
    )
