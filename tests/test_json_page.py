"""docs/json.md lists every verb with its document, and its examples follow the schemas."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from ros2_ws.src.trunk_experiments.test.documents import (
    VERBS,
    checked,
    documents_of,
    strict,
    validator,
)

PAGE = (Path(__file__).parents[1] / "docs" / "json.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `trunk ([^`]+)` \| `([^`]+)` \| `\.(\w+)", PAGE, re.MULTILINE)
EXAMPLES = re.findall(r"^```json\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_every_verb_has_a_line_for_each_document():
    wanted = {
        (" ".join(words), document)
        for words, verb in VERBS.items()
        for (documents,) in [documents_of(verb)]
        for document in documents
    }
    assert {(re.sub(" --.*", "", verb), name) for verb, name, _ in ROWS} == wanted
    assert "`error-1`" in PAGE


@pytest.mark.parametrize(("verb", "name", "key"), ROWS)
def test_the_key_in_a_line_is_required(verb, name, key):
    required = set(validator(name).schema["required"])
    assert key in required


def test_the_examples_are_documents():
    assert len(EXAMPLES) == 2
    for text in EXAMPLES:
        checked(text, strict(text)["schema"].removeprefix("trunk/"))
