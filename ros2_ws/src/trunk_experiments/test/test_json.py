"""``--json`` in general: the schemas, mistakes, what is said of a run; test_json_documents.py: each verb."""

import io
import json
import subprocess
import sys
from math import inf, nan
from pathlib import Path

import pytest

from trunk_core.results import plain
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.cli import main
from trunk_recording.reader import Recording

from .documents import SCHEMAS, VERBS, checked, documents_of, jsonschema, strict, validator


def test_every_verb_has_the_option():
    assert {words for words, verb in VERBS.items() if len(documents_of(verb)) != 1} == set()
    assert {("run",), ("list", "runs"), ("tune", "lqr"), ("params",)} <= set(VERBS)


@pytest.mark.parametrize("name", sorted(SCHEMAS))
def test_the_schemas_are_valid(name):
    schema = SCHEMAS[name]
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["properties"]["schema"] == {"const": f"trunk/{name}"}
    assert "schema" in schema["required"]
    assert not schema["additionalProperties"]


def test_a_key_that_the_schema_does_not_know_is_found(recordings_here, command_says):
    document = strict(command_says("metrics", "a.mcap", "--json")[1])
    assert validator("metrics-1").is_valid(document)
    for wrong in (
        {**document, "more": 1},
        {**document, "doubts": {**document["doubts"], "more": 1}},
        {**document, "metrics": {**document["metrics"], "iae": "0.3"}},
        {key: value for key, value in document.items() if key != "doubts"},
    ):
        assert not validator("metrics-1").is_valid(wrong)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("metrics nothing.mcap", 2, "nothing.mcap: No such file or directory"),
        ("info broken.mcap", 2, "broken.mcap"),
        ("verify broken.mcap", 2, "broken.mcap"),
        ("info --check broken.mcap", 2, "broken.mcap"),
        ("recover broken.mcap -o x.mcap", 2, "broken.mcap"),
        ("simulate fig8 -o a.mcap", 2, "--output a.mcap: it exists"),
        ("simulate fig8 -o /dev/stdout", 2, "with --json the document goes there"),
        ("simulate fig8 -o new.mcap --set pid.gains.p=x", 2, "gains.p"),
        ("compare a.mcap --csv", 2, "--json and --csv: give one of them"),
        ("compare", 2, "Missing argument 'RUN...'"),
        ("metricz a.mcap", 2, "did you mean 'metrics'?"),
        ("metrics a.mcap --nix", 2, "No such option"),
        ("tune", 2, "No such option '--json'"),
        ("params nix", 2, "params 'nix': give show, set, apply, or a node"),
        ("run fig8 --duration 0", 2, "a recorded run needs an end"),
        ("simulate -o x.mcap", 2, "--like"),
        ("simulate fig6 --duration 0 -o x.mcap", 2, "duration is 0"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_mistake_gives_a_line_and_a_document(recordings_here, command_says, words, code, says):
    plain_code, plain_out, plain_err = command_says(*words.split())
    found, out, err = command_says(*words.split(), "--json")
    document = checked(out, "error-1")
    assert (found, document["exit_code"]) == (code, code)
    assert says in document["error"]
    assert "\n" not in document["error"]
    assert document["error"] in " ".join(err.split())
    if "--json" not in says:  # where JSON itself is not the mistake
        assert (plain_code, plain_err) == (found, err)
        assert plain_out == ""


def test_an_interrupted_verb_has_no_document(recordings_here, command_says, monkeypatch):
    monkeypatch.setattr(Recording, "open", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    code, out, err = command_says("metrics", "a.mcap", "--json")
    assert (code, err.split()) == (130, ["interrupted"])
    assert out == ""


def test_a_run_that_diverges_still_gives_its_document(recordings_here, command_says):
    unstable = ("--controller", "pid", "--set", "pid.gains.d=1e6")
    words = ("simulate", "fig6", *unstable, "-o", "new.mcap")
    code, out, err = command_says(*words, "--json")
    document = checked(out, "simulate-1")
    assert code == 1
    assert document["failure"] == document["doubts"]["reason"]
    assert err.splitlines()[-1] == f"trunk: error: {document['failure']}"
    assert document["doubts"]["complete"] is False
    assert (
        document["states"] == Recording.open("new.mcap").topics["/ground_truth/joint_states"].count
    )
    assert command_says(*words, "--force") == (code, "", err)


def test_what_is_said_of_a_run(recordings_here, command_says):
    of = {
        name: checked(command_says(*words.split(), "--json")[1], name)
        for name, words in (
            ("info-1", "info a.mcap"),
            ("metrics-1", "metrics a.mcap"),
            ("verify-2", "verify a.mcap"),
        )
    }
    for document in of.values():
        assert document["doubts"]["complete"] is True
        assert document["doubts"]["reason"] is None
        assert document["doubts"]["fell"] == RecordedRun.open("a.mcap").fall.stamp_ns / 1e9
        assert document["doubts"]["late"] is None
    assert (of["info-1"]["scenario"], of["info-1"]["nodes"][:2]) == (
        "fig8",
        ["/disturbance", "/pid"],
    )
    judged = {name: document["doubts"]["judged"] for name, document in of.items()}
    assert judged == {"info-1": None, "metrics-1": None, "verify-2": "verified"}
    cut = checked(command_says("metrics", "cut.mcap", "--json")[1], "metrics-1")["doubts"]
    assert cut["complete"] is False
    assert cut["reason"]


def test_numbers_that_json_lacks_are_strings():
    values = {"a": [nan, inf, -inf, 1.5], "b": (Path("x"), None, True), 3: {"c": -0.0}}
    shown = json.loads(json.dumps(plain(values), allow_nan=False))
    assert shown == {
        "a": ["NaN", "Infinity", "-Infinity", 1.5],
        "b": ["x", None, True],
        "3": {"c": 0.0},
    }
    assert [float(word) for word in shown["a"][1:3]] == [inf, -inf]


def test_what_libraries_print_goes_to_stderr():
    """As Fast DDS does with its complaints, from C++."""
    code = """
import os, subprocess, sys
from trunk_experiments.cli import main
from trunk_experiments.commands import list as verb
quiet = verb.schemas
def noisy(root):
    print("of Python")
    os.write(1, b"of C\\n")
    subprocess.run(["echo", "of a process"], check=True)
    return quiet(root)
verb.schemas = noisy
sys.argv = ["trunk", "list", "schemas", "--json"]
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    checked(done.stdout, "list-schemas-1")
    assert sorted(done.stderr.splitlines()) == ["of C", "of Python", "of a process"]


class Gone(io.StringIO):
    """A pipe whose reader has gone."""

    def write(self, text):
        raise BrokenPipeError


@pytest.mark.parametrize(
    ("words", "code"), [(["list", "schemas"], 141), (["metrics", "nothing.mcap"], 2)]
)
def test_a_reader_that_goes_away_ends_the_verb_quietly(monkeypatch, words, code):
    """As with ``trunk … --json | true``: also where the document reports an error."""
    monkeypatch.setattr(sys, "argv", ["trunk", *words, "--json"])
    monkeypatch.setattr(sys, "stdout", Gone())
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == code
