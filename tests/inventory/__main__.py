"""What a user can name: verbs, parameters, topics, services, executables, the library, JSON documents.

    source scripts/env.sh && python -m tests.inventory [write]

Compares with `inventory.txt`, a line for each thing, and prints what differs as a diff; exit code 1 if
anything does. ``write``: freeze what is there now.
"""

import hashlib
import inspect
import json
import re
import sys
from collections.abc import Iterator
from difflib import unified_diff
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import click

import trunk_control.api
import trunk_experiments.api
from trunk_core import PACKAGES, errors
from trunk_core.parameters.declarations import declarations
from trunk_experiments.cli import OVERVIEW, trunk
from trunk_experiments.console.document import schemas
from trunk_runs.nodes import NODES
from trunk_views.markers import MarkersConfig

PLACE = Path(__file__).with_name("inventory.txt")
ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "ros2_ws/src"
TOPIC = re.compile(r"^\| `(\S+)` \| (\S+) \| (.+?) \|", re.MULTILINE)
SERVICE = re.compile(r'create_service\((\w+), "([^"]+)"')


def lines() -> Iterator[str]:
    """Yield a line for each thing that has a name."""
    for name, value in vars(errors).items():
        if name.startswith("EXIT_"):
            yield f"exit code {name} = {value}"
    for verb in OVERVIEW:
        command = trunk.get_command(click.Context(trunk), verb)
        assert command is not None, verb
        yield from _verbs(f"trunk {verb}", command)
    for node, config in {
        **{n: kind.config for n, kind in NODES.items()},
        "markers": MarkersConfig,
    }.items():
        for declared in declarations(config).values():
            yield f"parameter {node}: {declared}"
    for name, kind, publisher in TOPIC.findall(
        (ROOT / "docs/concepts.md").read_text(encoding="utf-8")
    ):
        yield f"topic {name}: {kind.replace('/', '/msg/')}: {publisher}"
    for path in sorted(SOURCES.glob("*/*/**/*_node.py")):
        for kind, name in SERVICE.findall(path.read_text(encoding="utf-8")):
            yield f"service {path.stem}: {name} ({kind})"
    for entry in entry_points(group="console_scripts"):
        if entry.dist and entry.dist.name.replace("-", "_") in PACKAGES:
            yield f"executable {entry.dist.name.replace('-', '_')}: {entry.name}"
    for module in (trunk_experiments.api, trunk_control.api):
        yield from library(module)
    for name, schema in schemas(trunk).items():
        text = json.dumps(schema, sort_keys=True)
        yield f"document {name}: SHA-256 {hashlib.sha256(text.encode()).hexdigest()[:16]}"


def _verbs(path: str, command: click.Command) -> Iterator[str]:
    yield f"verb {path}: {' '.join((command.help or '').split())}"
    for parameter in command.params:
        about = {
            key: value for key, value in parameter.to_info_dict().items() if value and key != "name"
        }
        yield f"  {path} {' '.join((*parameter.opts, *parameter.secondary_opts))}: {_plain(about)}"
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from _verbs(f"{path} {name}", below)


def _plain(about: dict[str, Any]) -> str:
    text = json.dumps(
        about, sort_keys=True, ensure_ascii=False, default=lambda value: type(value).__name__
    )
    return re.sub(r" at 0x[0-9a-f]+", "", text)


def library(module: ModuleType) -> Iterator[str]:
    """Yield a module's public names with their signatures, of classes with those of their members."""
    for name in sorted(module.__all__):
        value = getattr(module, name)
        yield f"library {module.__name__}.{name}{_signature(value)}"
        for member, one in sorted(vars(value).items()) if inspect.isclass(value) else ():
            if not member.startswith("_"):
                yield f"  {name}.{member}{_signature(one)}"


def _signature(value: object) -> str:
    if isinstance(value, property):
        value = value.fget
    try:
        return re.sub(r" at 0x[0-9a-f]+", "", str(inspect.signature(value)))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return ""


if __name__ == "__main__":
    now = [f"{line}\n" for line in lines()]
    if sys.argv[1:] == ["write"]:
        PLACE.write_text("".join(now), encoding="utf-8")
        print(f"{len(now)} lines written")
    else:
        before = PLACE.read_text(encoding="utf-8").splitlines(keepends=True)
        difference = list(unified_diff(before, now, "before", "now", n=0))
        print("".join(line[:300].rstrip("\n") + "\n" for line in difference), end="")
        sys.exit(bool(difference))
