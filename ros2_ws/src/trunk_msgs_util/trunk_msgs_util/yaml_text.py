"""YAML as this project reads it: plain values, numbers as in rcl, every mistake one line."""

from __future__ import annotations

import re
from typing import Any

import yaml

from .errors import TrunkError

MAX_DEPTH = 50  # of nested lists and mappings
MAX_LETTERS = 1 << 18  # of a text: some seconds of PyYAML's time
_SHOWN = 40  # characters quoted in an error
_MAX_INTEGER = 2**63 - 1
_LONGEST_INTEGER = (
    100  # characters, with underscores and in binary: longer ones are not even converted
)


class YamlTextError(TrunkError):
    """A text that cannot be used: the line, what is there, what to do."""


def load(text: str, longest: int = MAX_LETTERS) -> Any:
    """Return the value in a YAML text. Raises YamlTextError naming the line.

    As in rcl, ``1e3`` is a number, ``1:30`` a text, and aliases are refused. A key may appear only once in
    a mapping, integers have 64 bits, and a text has no more characters than ``longest``.
    """
    if len(text) > longest:
        raise YamlTextError(f"{len(text)} characters: at most {longest} are read")
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else "?"
        raise YamlTextError(f"line {line}: {_shown(str(error.problem), 4 * _SHOWN)}") from None
    except yaml.YAMLError as error:
        raise YamlTextError(f"not YAML: {' '.join(str(error).split())}") from None


class _Loader(yaml.SafeLoader):
    """Safe YAML without aliases, with an error for everything that PyYAML itself fails at."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            alias = _shown(f"*{event.anchor}")
            raise _mistake(f"an alias, '{alias}': write the value itself", event.start_mark)
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise _mistake(f"nested more than {MAX_DEPTH} deep", event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        if node.tag.endswith((":int", ":float")) and ":" in node.value:
            return node.value  # YAML 1.1 takes 1:30 for 90; rcl, YAML 1.2 and most people do not
        if node.tag.endswith(":int") and len(node.value) > _LONGEST_INTEGER:
            raise _mistake(f"{_shown(node.value)!r} is not a 64-bit integer", node.start_mark)
        try:
            found = super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError):  # "0x_", "!!bool q", "2026-13-45"
            kind = node.tag.rsplit(":", 1)[-1]
            shown = _shown(str(node.value))
            raise _mistake(f"{shown!r} is not a valid {kind}", node.start_mark) from None
        if isinstance(found, int) and abs(found) > _MAX_INTEGER:
            raise _mistake(f"{_shown(node.value)!r} is not a 64-bit integer", node.start_mark)
        return found

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _mistake("a list or mapping as a key: use a name", key.start_mark)
            if key.value in seen:
                raise _mistake(f"{_shown(key.value)!r} appears twice", key.start_mark)
            seen.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def _shown(text: str, longest: int = _SHOWN) -> str:
    return text if len(text) <= longest else text[: longest - 3] + "..."


def _mistake(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(problem=problem, problem_mark=mark)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)
