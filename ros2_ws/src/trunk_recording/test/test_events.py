"""The events of `run/events`: strings in messages and files, and the only ones that nodes publish."""

import ast
import json
import re
from pathlib import Path

import pytest

from trunk_core.topics import ENDS, Event
from trunk_recording import schemas

SOURCES = Path(__file__).parents[2]
PAGE = (SOURCES.parents[1] / "docs" / "recording.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| ([a-z ]+) \| (?:[a-z]+,? ?)+ \| ([\w., ]*) \| ", re.MULTILINE)
# The keys of each event's values, as docs/recording.md lists them.
CARRIES = {word: re.findall(r"[\w.]+", keys) for word, keys in ROW.findall(PAGE) if word != "event"}


@pytest.mark.parametrize("event", Event, ids=str)
def test_an_event_is_its_string(event):
    word = event.value
    assert (str(event), f"{event}", f"{event:>12}") == (word, word, f"{word:>12}")
    assert event == word
    assert Event(word) is event
    assert json.dumps([event]) == json.dumps([word])
    assert schemas.event(7, "/sim", event) == schemas.event(7, "/sim", word)
    assert schemas.parse_event(schemas.event(7, "/sim", event)).message == event


def test_the_page_lists_each_event():
    assert list(CARRIES) == list(Event)


def test_events_that_end_a_run_give_reason_and_states():
    assert [CARRIES[event][:2] for event in ENDS] == [["reason", "states"]] * 3


def said(path):
    """Yield the events that a source puts on the record, and the names of their values."""
    for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute):
            if call.func.attr not in ("event", "_event", "_say_finished") or not call.args:
                continue
            words = [node for node in ast.walk(call.args[0]) if isinstance(node, ast.Constant)]
            assert not [w for w in words if isinstance(w.value, str)], f"{path}: a bare word"
            for node in ast.walk(call.args[0]):
                if isinstance(node, ast.Attribute) and node.attr in Event.__members__:
                    yield Event[node.attr], {keyword.arg for keyword in call.keywords}


def test_nodes_publish_every_event_and_no_other():
    found = [
        pair
        for path in sorted(SOURCES.glob("*/trunk_*/**/*.py"))
        for pair in said(path)
        if "/test/" not in str(path)
    ]
    assert {event for event, _ in found} == set(Event)
    for event, keys in found:
        assert keys - {None, "level"} <= set(CARRIES[event]), event
