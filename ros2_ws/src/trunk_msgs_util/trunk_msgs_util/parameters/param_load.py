"""What ``ros2 param load`` means by a value, which it sends as YAML reads the value's Python text.

``.inf`` in the file arrives as the text ``inf``, ``1.0e-05`` as ``1e-05`` and ``[.inf, 0.5]`` as
``[inf, 0.5]``; the text ``"1.5"`` arrives as a number. Pure.
"""

from __future__ import annotations

import re

import yaml

from .declarations import Declaration, Value

_NUMBER = re.compile(r"[-+]?(inf|\d+(\.\d*)?(e[-+]?\d+)?)", re.ASCII)


def meant(declaration: Declaration, value: object, present: Value) -> object:
    """Return what a value sent for a parameter means; ``present`` is the parameter's current value.

    A number's text is the number where a double is declared. For a declared string, a value of another
    type is the present text if YAML reads that text so. Everything else is returned as it is, to be
    checked or refused as it was sent.
    """
    if declaration.kind == "double" and isinstance(value, str):
        return _number(value)
    if declaration.kind == "double array":
        return _numbers(value)
    if declaration.kind == "string" and isinstance(value, bool | int | float):
        return present if _reads_as(present, value) else value
    return value


def _number(item: object) -> object:
    if isinstance(item, str) and _NUMBER.fullmatch(item):
        return float(item)
    return item


def _numbers(value: object) -> object:
    if isinstance(value, str) and value.startswith("[") and value.endswith("]"):
        items = [_number(item.strip()) for item in value[1:-1].split(",")]
    elif isinstance(value, list):
        items = [_number(item) for item in value]
    else:
        return value
    return value if any(isinstance(item, str) for item in items) else items


def _reads_as(text: Value, value: object) -> bool:
    try:
        read = yaml.safe_load(str(text))
    except (yaml.YAMLError, ValueError):
        return False
    return type(read) is type(value) and repr(read) == repr(value)
