"""Parse what a user writes on a command line: a value, a namespace, one parameter's setting."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress

from trunk_msgs_util.text import shortened
from trunk_msgs_util.yaml_text import YamlTextError, load

from ..errors import PlanError
from .nodes import NODES


def quoted(text: str) -> str:
    """Return a text as an error quotes it."""
    return repr(shortened(text, 80))


def value_of(text: str, origin: str) -> object:
    """Return the value in a YAML text. Raises PlanError, which begins with ``origin``."""
    try:
        value = load(text)
    except YamlTextError as error:
        raise PlanError(f"{origin}: the value cannot be read: {error}") from None
    if isinstance(value, str):
        with suppress(ValueError):
            return float(value)  # "inf" is a number to the user, but not to YAML
    return value


def settings_of(texts: Iterable[str]) -> Mapping[str, object]:
    """Return the values by name of ``NAME=VALUE`` texts; VALUE is YAML. Raises PlanError."""
    values: dict[str, object] = {}
    for text in texts:
        name, equals, value_text = text.partition("=")
        if not equals or not name:
            raise PlanError(f"{quoted(text)}: NAME=VALUE is needed, such as gains.p=70")
        if name in values:
            raise PlanError(f"{quoted(text)}: {name} is given twice: give one value")
        value = value_of(value_text, quoted(text))
        if value is None:
            raise PlanError(f"{quoted(text)}: no value: give one, an empty text as {name}='\"\"'")
        values[name] = value
    return values


def checked_external(name: str) -> str:
    """Return the name that a run with somebody else's controller goes by. Raises PlanError."""
    if name and not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,99}", name):
        raise PlanError(
            f"--external {name!r} is not allowed: letters, digits and _, no digit first, such as my_pd"
        )
    if name in NODES:
        raise PlanError(
            f"--external {name}: that is a node of this project: give your node another name, "
            f"or run ours with --controller {name}"
        )
    return name


def checked_namespace(text: str) -> str:
    """Return a plan's namespace from a user's ``robot1`` or ``/robot1``; empty: none.

    Raises PlanError.
    """
    if text in ("", "/"):
        return ""
    namespace = "/" + text.strip("/")
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", namespace):
        raise PlanError(
            f"namespace {text!r} is not allowed: letters, digits and _, no digit first, "
            "such as robot1 or left/robot1"
        )
    return namespace
