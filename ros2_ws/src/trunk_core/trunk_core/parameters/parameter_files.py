"""ROS 2 parameter files, read and written without ROS, with the meaning that rcl gives them.

A file maps node names to ``ros__parameters``; in a node's name ``*`` stands for one token and ``**`` for
any number. Layers are applied in the order given, later ones win: inside a layer, sections apply in the
order of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import TrunkError
from ..files import atomic_write
from ..yaml_text import YamlTextError, dump, load
from .declarations import is_qos_override, of_every_node, table_of, unknown_name


class ParameterFileError(TrunkError):
    """A parameter file that cannot be used: the file, the place, what to do."""


@dataclass(frozen=True)
class Section:
    """One node's entry: the name's pattern as written, and values by dotted parameter name."""

    pattern: str
    values: Mapping[str, object]

    def matches(self, node: str) -> bool:
        """Return True if the pattern covers the fully qualified node name."""
        pattern = self.pattern if self.pattern.startswith("/") else "/" + self.pattern
        parts = re.split(r"(/\*\*|/\*)", pattern)
        expressions = {"/**": r"(/\w+)*", "/*": r"/\w+"}
        return bool(re.fullmatch("".join(expressions.get(p, re.escape(p)) for p in parts), node))

    @property
    def last_token(self) -> str:
        """The node's base name, or a wildcard."""
        return self.pattern.rsplit("/", 1)[-1]


@dataclass(frozen=True)
class Layer:
    """A parameter file's content, or values from a command line; ``source`` names it in errors.

    ``folder``: what the paths in it are relative to; the working directory where it is no file.
    """

    source: str
    sections: Sequence[Section]
    folder: Path = Path()

    def within(self, namespace: str) -> Layer:
        """Return the layer with its bare node names (``pid``, not ``/pid`` or ``arm/pid``) in the namespace.

        rcl takes ``pid`` for ``/pid``, and ``arm/pid`` for ``/arm/pid``: this is for a file that is
        resolved here and not passed to nodes.
        """
        return Layer(
            self.source,
            tuple(
                s
                if not namespace or "/" in s.pattern or "*" in s.pattern
                else Section(f"{namespace}/{s.pattern}", s.values)
                for s in self.sections
            ),
            self.folder,
        )


def _flatten(
    values: Mapping[Any, Any], where: str, prefix: str = "", flat: dict[str, object] | None = None
) -> dict[str, object]:
    """Return values by dotted name. Raises ParameterFileError for one that is there twice."""
    flat = {} if flat is None else flat
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            _flatten(value, where, name + ".", flat)
        elif name in flat:  # rcl would silently take the last
            raise ParameterFileError(
                f"{where}: parameter {name!r} appears twice, dotted and nested: leave one out"
            )
        else:
            flat[name] = value
    return flat


def _sections(tree: Any, source: str, path: str = "") -> Iterable[Section]:
    if not isinstance(tree, dict):
        raise ParameterFileError(f"{source}: {path or 'the file'} is not a mapping of node names")
    for key, below in tree.items():
        if key == "ros__parameters":
            if not isinstance(below, dict):
                raise ParameterFileError(f"{source}: {path}: ros__parameters is not a mapping")
            yield Section(path, _flatten(below, f"{source}: {path}"))
        else:
            yield from _sections(below, source, f"{path.rstrip('/')}/{key}" if path else str(key))


def parse(text: str, source: str) -> Layer:
    """Return the layer in a file's text. Raises ParameterFileError naming the source and the line."""
    try:
        tree = load(text)
    except YamlTextError as error:
        raise ParameterFileError(f"{source}: {error}") from None
    sections = tuple(_sections(tree, source))
    if not sections:
        raise ParameterFileError(
            f"{source}: no ros__parameters in it; see any shipped parameter file"
        )
    return Layer(source, sections)


def read(path: Path) -> Layer:
    """Return the layer in a parameter file. Raises ParameterFileError naming file and line."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ParameterFileError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ParameterFileError(f"{path}: not a text file; give a ROS 2 parameter file") from None
    return replace(parse(text, str(path)), folder=path.parent)


def resolve(node: str, layers: Iterable[Layer], declared: Iterable[str]) -> dict[str, object]:
    """Return the layers' values for a node (fully qualified name), of the parameters that it declares.

    A cell of a table is a value of its own, and goes with the table that a later section gives.
    """
    names = set(declared)
    values: dict[str, object] = {}
    for layer in layers:
        for section in layer.sections:
            if not section.matches(node):
                continue
            for name in [cell for cell in values if table_of(cell, names) in section.values]:
                del values[name]
            values.update(
                {k: v for k, v in section.values.items() if k in names or table_of(k, names)}
            )
    return values


def qos_overrides(node: str, layers: Sequence[Layer]) -> dict[str, object]:
    """Return the layers' quality of service for a node (fully qualified name), by ROS's own parameters."""
    names = {name for layer in layers for s in layer.sections for name in s.values}
    overrides = filter(is_qos_override, names)
    return resolve(node, layers, overrides)


def check_names(layers: Iterable[Layer], nodes: Mapping[str, Iterable[str]]) -> None:
    """Refuse misspelt parameters: each must be declared by a node that its section can apply to.

    ``nodes``: the declared parameter names by node base name. Sections of other projects' nodes are
    accepted, and so is what every ROS node has (``use_sim_time``): a node's dump can be used as it is.
    Raises ParameterFileError naming the file, the section and the parameter.
    """
    declared = {node: dict.fromkeys(names) for node, names in nodes.items()}  # in order
    everything = {name: None for names in declared.values() for name in names}
    for layer in layers:
        for section in layer.sections:
            token = section.last_token
            if token not in declared and "*" not in token:
                continue
            known = declared.get(token, everything)
            for name in section.values:
                if name not in known and not table_of(name, known) and not of_every_node(name):
                    raise ParameterFileError(
                        f"{layer.source}: {section.pattern}: parameter {name!r}: "
                        f"{unknown_name(name, known)}"
                    )


def write(path: Path, nodes: Mapping[str, Mapping[str, object]]) -> None:
    """Write one section per node, each value exactly (floats by their shortest round-trip text)."""
    tree = {
        node: {
            "ros__parameters": {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in values.items()
            }
        }
        for node, values in nodes.items()
    }
    with atomic_write(path) as part:
        part.write_text(dump(tree, width=100), encoding="utf-8")
