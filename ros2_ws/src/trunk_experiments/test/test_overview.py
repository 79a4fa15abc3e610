"""The overview of the verbs, their help, and the names that some of them had."""

from __future__ import annotations

import json

import pytest

from trunk_experiments.cli import OVERVIEW, trunk

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
    assert shown == set(OVERVIEW) - {"fit"}
    assert len(lines) == len(shown) + 6  # a line for each verb, no space between families
    assert lines[-1].endswith("For fit, too: trunk help --all.")


def test_all_verbs_are_listed_on_demand(command_says):
    _, out, _ = command_says("help", "--all")
    assert {line[11:21].strip() for line in out.splitlines()[4:-2]} == set(OVERVIEW)
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.slow
@pytest.mark.parametrize("words", dict.fromkeys(NAMES), ids=" ".join)
def test_help_on_a_verb_is_its_own(words, command_says):
    assert command_says("help", *words) == command_says(*words, "--help")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["help", "sweeep"],
            "no verb 'sweeep': trunk help --all lists them all; did you mean 'sweep'?",
        ),
        (["hepl"], "no verb 'hepl': trunk help --all lists them all; did you mean 'help'?"),
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


def name_of(line):
    """Return the words of a verb's name in a command line."""
    words = line.split()
    return words[:2] if tuple(words[:2]) in VERBS else words[:1]


@pytest.mark.parametrize(
    ("before", "now"),
    [
        ("map nothing.parquet", "study map nothing.parquet"),
        ("compare --study out.txt --csv", "study compare out.txt --csv"),
        ("compare --csv --study=out.txt", "study compare --csv out.txt"),
        ("new controller A", "controller new A"),
        ("new controller", "controller new"),
        ("check controller pdi", "controller check pdi"),
        ("check node --rate 0 --namespace controller", "controller check-node --rate 0"),
        ("check --help", "controller --help"),
        ("new", "controller"),
    ],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_an_old_name_does_the_same_and_says_the_new_one(
    before, now, as_json, command_says, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out.txt").write_text("no study")
    options = ["--json"] if as_json else []
    code, out, err = command_says(*before.split(), *options)
    renaming, _, rest = err.partition("\n")
    assert renaming.startswith("trunk: warning: trunk ")
    assert f"is now trunk {' '.join(name_of(now))};" in renaming
    assert (code, out, rest) == command_says(*now.split(), *options)
    if as_json and out:
        assert json.loads(out)["schema"] == "trunk/error-1"


def test_help_takes_an_old_name(command_says):
    code, out, err = command_says("help", "check", "node")
    assert err.startswith("trunk: warning: trunk check node is now trunk controller check-node;")
    assert (code, out, "") == command_says("help", "controller", "check-node")


def test_names_that_are_no_longer_shown_still_work():
    assert not {"map", "new", "check"} & set(OVERVIEW)
    assert "--study" not in str(trunk.get_command(None, "compare").params)
