"""Samples of every document, one a line of ``json_samples.jsonl``: what its schema takes and what it refuses.

``free``: the changes that the schema allows, as in a value of any type.
"""

import json
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from .documents import SCHEMAS, validator

SAMPLES = [
    json.loads(line)
    for line in Path(__file__).with_name("json_samples.jsonl").read_text("utf-8").splitlines()
]
STRANGE: list[Any] = [[{}]]


def names() -> set[str]:
    return {sample["document"]["schema"].removeprefix("trunk/") for sample in SAMPLES}


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield where the objects of a document are; of a list, in its first item."""
    if isinstance(value, dict):
        yield path
        for key, item in value.items():
            yield from places(item, (*path, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*path, 0))


def changes(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the document with a field dropped, of a strange type, or added, and what was done where."""
    for place in places(document):
        for done in ("dropped", "mistyped", "added"):
            inner: Any = document
            for key in place:
                inner = inner[key]
            for field in [*inner] if done != "added" else ["more"]:
                changed = deepcopy(document)
                inner = changed
                for key in place:
                    inner = inner[key]
                if done == "dropped":
                    del inner[field]
                else:
                    inner[field] = STRANGE
                yield f"{done} {'/'.join(map(str, (*place, field)))}", changed


def test_every_document_has_a_sample():
    assert names() == set(SCHEMAS)


@pytest.mark.parametrize(
    "sample", SAMPLES, ids=lambda sample: sample["document"]["schema"].removeprefix("trunk/")
)
def test_a_sample_is_valid_and_no_longer_once_it_is_changed(sample):
    document, free = sample["document"], sample["free"]
    valid = validator(document["schema"].removeprefix("trunk/"))
    valid.validate(document)
    assert [what for what, changed in changes(document) if valid.is_valid(changed)] == free
