"""The overview of the verbs, their help, and the names that some of them had."""

import pytest

from trunk_experiments.cli import OVERVIEW


def test_the_first_screen_has_each_family_and_fits_80_columns(command_says):
    code, out, err = command_says("--help")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    verbs, begin = lines[4:-5], lines[-4:]
    assert [line[:9].strip() for line in verbs if line[:1].strip()] == (
        ["run", "look", "trust", "many runs", "tools"]
    )
    assert {line[11:21].strip() for line in verbs} == set(OVERVIEW)
    assert len(verbs) == len(OVERVIEW)  # a line for each verb, no space between families
    assert begin[0].endswith("To begin with:")
    assert all(line.startswith("  trunk ") for line in begin[1:])


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["sweeep"], "no verb 'sweeep': trunk lists them all; did you mean 'sweep'?"),
        (["fit", "path", "a.csv"], "trunk fit is now: python examples/fit_hip_path.py"),
        (["doctor", "a.mcap"], "trunk doctor is now: trunk info --check RUN"),
        (["import", "fuzzy", "a.fis"], "trunk import is now: trunk rules read FILE"),
        (["sign", "a"], "trunk sign is now: ssh-keygen -Y sign -n trunk -f KEY RUN.mcap"),
        (["watch", "a.mcap"], "trunk watch is now: trunk report RUN --open"),
        (["export-web", "fig8"], "trunk export-web is now: trunk lab SCENARIO"),
        (
            ["study", "sensitivity", "s"],
            "trunk study sensitivity is now: trunk sweep STUDY --sobol N",
        ),
        (
            ["study", "mpa"],
            "trunk study 'mpa': give one of map, compare, report, show; did you mean 'map'?",
        ),
    ],
    ids=str,
)
def test_an_unknown_verb_is_answered_with_one_that_is_there(words, line, command_says):
    assert command_says(*words) == (2, "", f"trunk: error: {line}\n")
