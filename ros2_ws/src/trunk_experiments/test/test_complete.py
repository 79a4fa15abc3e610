"""The shell completes verbs, scenarios, controllers, parameter files and studies, and files elsewhere."""

import os
import subprocess

import pytest
from click.shell_completion import ShellComplete

from trunk_experiments.cli import trunk
from trunk_runs.processes import find_executable


@pytest.mark.parametrize(
    ("words", "begun", "found"),
    [
        ([], "sim", ["simulate"]),
        (["simulate"], "fig", ["fig6", "fig7", "fig8", "fig9"]),
        (["run"], "d", ["demo"]),
        (["run", "fig8", "--controller"], "f", ["fuzzy_pid", "fuzzy"]),
        (["plan", "fig8", "--params"], "pid_as", ["pid_as_printed"]),
        (["sweep"], "r", ["robustness", "rules"]),
        (["list"], "s", ["scenarios", "schemas", "studies"]),
        (["study"], "s", ["show"]),
        (["controller"], "ch", ["check"]),
        (["controller", "check"], "fuzzy", ["fuzzy_pid", "fuzzy"]),
        (["simulat"], "z", []),
        (["params"], "s", ["set", "show", "simulator", "state_feedback"]),
        (["params", "show"], "fuzzy_z", ["fuzzy_zhao_1993"]),
        (["params", "set"], "fuzzy", ["fuzzy_pid", "fuzzy"]),
        (["params", "apply", "pid"], "pid_as", ["pid_as_printed"]),
        (["params", "nothing"], "x", []),
    ],
)
def test_names(words, begun, found):
    completer = ShellComplete(trunk, {}, "trunk", "_TRUNK_COMPLETE")
    assert [item.value for item in completer.get_completions(words, begun)] == found


@pytest.mark.parametrize("words", [["simulate"], ["simulate", "fig8", "--params"], ["sweep"]])
def test_anything_else_is_a_file(words):
    (item,) = ShellComplete(trunk, {}, "trunk", "_TRUNK_COMPLETE").get_completions(words, "./my")
    assert (item.type, item.value) == ("file", "./my")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_is_given_what_it_sources(shell):
    trunk_path = find_executable("trunk_experiments", "trunk")
    environment = {**os.environ, "_TRUNK_COMPLETE": f"{shell}_source"}
    done = subprocess.run([trunk_path], env=environment, capture_output=True, text=True, check=True)
    assert f"_TRUNK_COMPLETE={shell}_complete" in done.stdout


def test_bash_completes_a_scenario(tmp_path):
    trunk_path = find_executable("trunk_experiments", "trunk")
    script = """
        PATH=$1:$PATH
        eval "$(_TRUNK_COMPLETE=bash_source trunk)"
        COMP_WORDS=(trunk simulate fi) COMP_CWORD=2
        _trunk_completion trunk
        printf '%s\\n' "${COMPREPLY[@]}"
    """
    words = ["bash", "-c", script, "bash", str(trunk_path.parent)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.split() == ["fig6", "fig7", "fig8", "fig9"]
