"""YAML as this project reads and writes it: plain values, numbers as in rcl, every mistake one line."""

from __future__ import annotations

import re
from typing import Any

import yaml

from .errors import TrunkError
from .text import shortened

MAX_DEPTH = 50  # of nested lists and mappings
MAX_LETTERS = 1 << 18  # of a text: some seconds of PyYAML's time
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
        raise YamlTextError(f"line {line}: {shortened(str(error.problem), 160)}") from None
    except yaml.YAMLError as error:
        raise YamlTextError(f"not YAML: {' '.join(str(error).split())}") from None


def dump(value: object, **options: Any) -> str:
    """Return a value as YAML without aliases, mappings in their order; ``options`` are PyYAML's."""
    text: str = yaml.dump(value, Dumper=_Dumper, sort_keys=False, **options)
    return text


class _Dumper(yaml.SafeDumper):
    """Writes equal values out each time: our readers refuse aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True


class _Loader(yaml.SafeLoader):
    """Safe YAML without aliases, with an error for everything that PyYAML itself fails at."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            alias = shortened(f"*{event.anchor}")
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
            raise _mistake(f"{shortened(node.value)!r} is not a 64-bit integer", node.start_mark)
        try:
            value = super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError):  # "0x_", "!!bool q", "2026-13-45"
            kind = node.tag.rsplit(":", 1)[-1]
            quoted = shortened(str(node.value))
            raise _mistake(f"{quoted!r} is not a valid {kind}", node.start_mark) from None
        if isinstance(value, int) and abs(value) > _MAX_INTEGER:
            raise _mistake(f"{shortened(node.value)!r} is not a 64-bit integer", node.start_mark)
        return value

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _mistake("a list or mapping as a key: use a name", key.start_mark)
            if key.value in seen:
                raise _mistake(f"{shortened(key.value)!r} appears twice", key.start_mark)
            seen.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def _mistake(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(problem=problem, problem_mark=mark)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)
