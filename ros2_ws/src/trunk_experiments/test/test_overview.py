"""The overview of the verbs, their help, and the names that some of them had."""

from __future__ import annotations

import pytest

from trunk_experiments.cli import OVERVIEW

from .documents import VERBS

NAMES = [(), *((word,) for word in OVERVIEW), *VERBS]


def test_the_first_screen_has_each_family_and_fits_80_columns(command_says):
    code, out, err = command_says("--help")
    assert (code, err) == (0, "")
    assert command_says("help") == (code, out, err)
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line[:9].strip() for line in lines if line[:1].strip()][1:-1] == (
        ["run", "look", "trust", "many runs", "tools"]
    )
    shown = {line[11:21].strip() for line in lines[4:-2]}
    assert shown == set(OVERVIEW)
    assert len(lines) == len(shown) + 6  # a line for each verb, no space between families


@pytest.mark.slow
@pytest.mark.parametrize("words", dict.fromkeys(NAMES), ids=" ".join)
def test_help_on_a_verb_is_its_own(words, command_says):
    assert command_says("help", *words) == command_says(*words, "--help")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["help", "sweeep"], "no verb 'sweeep': trunk help lists them all; did you mean 'sweep'?"),
        (["hepl"], "no verb 'hepl': trunk help lists them all; did you mean 'help'?"),
        (["fit", "path", "a.csv"], "no verb 'fit': run examples/fit_hip_path.py"),
        (
            ["help", "study", "mpa"],
            (
                "trunk study 'mpa': give one of map, compare, report, show, sensitivity; "
                "did you mean 'map'?"
            ),
        ),
        (["help", "metrics", "iae"], "trunk metrics 'iae': it has no verbs of its own"),
    ],
    ids=str,
)
def test_help_on_an_unknown_verb_suggests_one(words, line, command_says):
    assert command_says(*words) == (2, "", f"trunk: error: {line}\n")
