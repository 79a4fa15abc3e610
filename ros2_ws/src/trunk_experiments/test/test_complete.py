"""The shell completes verbs, scenarios, controllers, parameter files and studies, and files elsewhere."""

from __future__ import annotations

import pytest
from click.shell_completion import ShellComplete

from trunk_experiments.cli import trunk


@pytest.mark.parametrize(
    ("words", "begun", "found"),
    [
        ([], "sim", ["simulate"]),
        (["simulate"], "fig", ["fig6", "fig7", "fig8", "fig9"]),
        (["run"], "d", ["demo"]),
        (["run", "fig8", "--controller"], "f", ["fuzzy_pid"]),
        (["plan", "fig8", "--params"], "pid_as", ["pid_as_printed"]),
        (["sweep"], "r", ["robustness"]),
        (["map"], "d", ["delay_gain"]),
        (["list"], "s", ["scenarios", "studies"]),
        (["simulat"], "f", []),
    ],
)
def test_names(words, begun, found):
    completer = ShellComplete(trunk, {}, "trunk", "_TRUNK_COMPLETE")
    assert [item.value for item in completer.get_completions(words, begun)] == found


@pytest.mark.parametrize("words", [["simulate"], ["simulate", "fig8", "--params"], ["sweep"]])
def test_anything_else_is_a_file(words):
    (item,) = ShellComplete(trunk, {}, "trunk", "_TRUNK_COMPLETE").get_completions(words, "./my")
    assert (item.type, item.value) == ("file", "./my")
