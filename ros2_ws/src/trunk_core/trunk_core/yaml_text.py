"""YAML as this project reads and writes it: plain values as in rcl, every mistake one line."""

from __future__ import annotations

import re
from math import isinf
from typing import Any

import yaml

from .errors import TrunkError
from .text import shortened

MAX_DEPTH = 50  # of nested lists and mappings
MAX_LETTERS = 1 << 18  # of a text: some seconds of PyYAML's time
_TAGS = {kind: f"tag:yaml.org,2002:{kind.__name__}" for kind in (bool, int, float, str)}
_BOOLEANS = {
    form: value
    for value, words in ((True, "y yes true on"), (False, "n no false off"))
    for word in words.split()
    for form in (word, word.title(), word.upper())
}
_INTEGER = re.compile(r"[-+]?(?:(0[xX][0-9a-fA-F]+)|(0[0-7]*)|[1-9][0-9]*)")
_HEXADECIMAL = re.compile(r"[-+]?0[xX]")
_DOTTED = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


class YamlTextError(TrunkError):
    """A text that cannot be used: the line, what is there, what to do."""


def load(text: str, longest: int = MAX_LETTERS) -> Any:
    """Return the value in a YAML text. Raises YamlTextError naming the line.

    Without quotes a value is what `as_rcl` says, but ``null`` and ``~`` are None; a key is a text. Aliases
    are refused, a key may appear only once in a mapping, and a text has no more characters than ``longest``.
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


def as_rcl(text: str) -> bool | int | float | str:
    """Return what a node takes a value without quotes for: ``N`` is False, ``1e3`` 1000.0, ``1_0`` a text.

    This is get_value in rcl_yaml_param_parser, with C's strtol and strtod; but numbers below 2.3e-308 are
    numbers.
    """
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if not text.isascii() or "_" in text:
        return text
    try:
        if found := _INTEGER.fullmatch(text):
            value = int(text, 16 if found[1] else 8 if found[2] else 10)
            if -(2**63) <= value < 2**63:
                return value
        plain = text.replace(".", "") if _DOTTED.fullmatch(text) else text
        number = float.fromhex(plain) if _HEXADECIMAL.match(plain) else float(plain)
    except (ValueError, OverflowError):
        return text
    return text if isinf(number) and "n" not in text.lower() else number


def dump(value: object, **options: Any) -> str:
    """Return a value as YAML without aliases, mappings in their order; ``options`` are PyYAML's.

    A text that PyYAML or rcl would take for something else is in quotes.
    """
    text: str = yaml.dump(value, Dumper=_Dumper, sort_keys=False, **options)
    return text


def on_one_line(value: object) -> str:
    """Return a value as YAML on one line, as after ``--set NAME=``."""
    text = dump(value, default_flow_style=True, width=float("inf"))
    return text.removesuffix("...\n").strip()


class _Dumper(yaml.SafeDumper):
    """Writes equal values out each time: our readers refuse aliases."""

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        tag = super().resolve(kind, value, implicit)
        text = kind is yaml.ScalarNode and implicit[0] and tag == _TAGS[str]
        return _TAGS[type(as_rcl(value))] if text else tag

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

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        tag = super().resolve(kind, value, implicit)
        if kind is not yaml.ScalarNode or not implicit[0] or tag == "tag:yaml.org,2002:null":
            return tag
        return _TAGS[type(as_rcl(value))]

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError):  # "!!bool q", "!!timestamp 2026-13-45"
            kind = node.tag.rsplit(":", 1)[-1]
            quoted = shortened(str(node.value))
            raise _mistake(f"{quoted!r} is not a valid {kind}", node.start_mark) from None

    def plain(self, node: Any) -> bool | int | float:
        """Return a boolean or a number. Raises ValueError for a text that is marked as one."""
        value = as_rcl(self.construct_scalar(node))
        if isinstance(value, str):
            raise ValueError(value)
        return value

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _mistake("a list or mapping as a key: use a name", key.start_mark)
            key.tag = _TAGS[str]
            if key.value in seen:
                raise _mistake(f"{shortened(key.value)!r} appears twice", key.start_mark)
            seen.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def _mistake(problem: str, mark: Any) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(problem=problem, problem_mark=mark)


for _kind in (bool, int, float):
    _Loader.add_constructor(_TAGS[_kind], _Loader.plain)
