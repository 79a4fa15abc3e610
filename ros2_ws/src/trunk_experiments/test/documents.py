"""What tests know of the documents that verbs write: which, their schemas, and whether a text is one."""

import json
from typing import Any

import click
import pytest

from trunk_experiments.cli import trunk
from trunk_experiments.console.document import JsonOption, schemas

jsonschema = pytest.importorskip("jsonschema")


def leaves(command, context, words=()):
    """Yield every command that can be given, with its words: of groups those that do something alone."""
    if not isinstance(command, click.Group) or command.invoke_without_command:
        yield words, command
    if isinstance(command, click.Group):
        inner = click.Context(command, parent=context, info_name=words[-1] if words else "trunk")
        for name in command.list_commands(inner):
            yield from leaves(command.get_command(inner, name), inner, (*words, name))


def documents_of(command):
    """Return the documents that a command's ``--json`` names, for each such option."""
    options = [p for p in command.params if isinstance(p, JsonOption)]
    return [tuple(kind.document for kind in option.documents) for option in options]


VERBS = dict(leaves(trunk, None))
SCHEMAS = schemas(trunk)


def validator(name):
    """Return the checker of a document."""
    return jsonschema.Draft202012Validator(SCHEMAS[name])


def strict(text: str) -> dict[str, Any]:
    """Return the one document of a text; NaN and infinities, which JSON does not have, fail."""

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    found: dict[str, Any] = json.loads(text, parse_constant=refuse)
    return found


def checked(text: str, name: str) -> dict[str, Any]:
    """Return the document of a text after checking it against its schema."""
    document = strict(text)
    assert document["schema"] == f"trunk/{name}"
    validator(name).validate(document)
    return document
