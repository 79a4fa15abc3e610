"""The public names with their signatures and docstrings, as docs/api.md lists them."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from types import FunctionType
from typing import Any


def reference(module: Any) -> str:
    """Return everything that a module's ``__all__`` names, as Markdown."""
    return "\n\n".join(_entry(name, getattr(module, name)) for name in module.__all__)


def _entry(name: str, value: Any) -> str:
    if isinstance(value, FunctionType):
        return f"### `{name}`\n\n{_code(_signature(name, value))}\n\n{_text(value)}"
    if not isinstance(value, type):
        return f"### `{name}`\n\nA constant: the unit of each column and metric, by name; empty: no unit."
    if issubclass(value, Exception):
        bases = ", ".join(base.__name__ for base in value.__bases__)
        return f"### `{name}`\n\n{_code(f'class {name}({bases})')}\n\n{_text(value)}"
    parts = [f"### `{name}`", _text(value)]
    attributes = list(_attributes(value))
    if attributes:
        wide = any(
            text for _, _, text in attributes
        )  # otherwise the class's docstring explains them
        rows = [f"| `{n}` | `{kind}` |" + f" {text} |" * wide for n, kind, text in attributes]
        head = ["| attribute | type |" + " what |" * wide, "|---|---|" + "---|" * wide]
        parts.append("\n".join([*head, *rows]))
    if is_dataclass(value) and "Made by" not in (value.__doc__ or ""):
        parts.insert(1, _code(_signature(name, value.__init__)))
    parts += [
        f"{_code(_signature(f'{name}.{method_name}', method))}\n\n{_text(method)}"
        for method_name, method in _methods(value)
    ]
    return "\n\n".join(parts)


def _members(kind: type) -> Iterator[tuple[str, Any]]:
    """Yield the members of a class and its bases, in order, except names that are private or special."""
    members: dict[str, Any] = {}
    for base in reversed(kind.__mro__[:-1]):
        members |= vars(base)
    for name, value in members.items():
        if not name.startswith("_") or name in ("__len__", "__getitem__"):
            yield name, value


def _attributes(kind: type) -> Iterator[tuple[str, str, str]]:
    annotations: dict[str, str] = {}
    if is_dataclass(kind):
        annotations = {field.name: str(field.type) for field in fields(kind)}
    elif hasattr(kind, "_fields"):
        annotations = {name: kind.__annotations__[name].__forward_arg__ for name in kind._fields}
    for name, annotation in annotations.items():
        if not name.startswith("_"):
            yield name, *_described(annotation)
    for name, value in _members(kind):
        if isinstance(value, property):
            returned = inspect.get_annotations(value.fget)["return"]  # type: ignore[arg-type]
            yield name, _described(returned)[0], _text(value).replace("\n", " ")


def _described(annotation: str) -> tuple[str, str]:
    """Return a type and, of one in ``Annotated``, its description, as cells of a table."""
    node, words = ast.parse(annotation, mode="eval").body, []
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Annotated":
        assert isinstance(node.slice, ast.Tuple)
        node, *extras = node.slice.elts
        for extra in extras:
            constants = [extra]
            if isinstance(extra, ast.Call) and ast.unparse(extra.func) == "Quantity":
                constants = extra.args[:2]  # its name and its unit
            words += [
                constant.value for constant in constants if isinstance(constant, ast.Constant)
            ]
    kind = ast.unparse(node).replace("Known", "float").replace("Count", "int")
    return kind.replace("|", r"\|"), ", ".join(map(str, words)).replace("|", r"\|")


def _methods(kind: type) -> Iterator[tuple[str, Any]]:
    return ((name, value) for name, value in _members(kind) if isinstance(value, FunctionType))


class _Verbatim:
    """Shown as it is written, without quotation marks."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def _signature(name: str, function: Any) -> str:
    """Return a signature as it is written, whatever the version of Python."""
    signature = inspect.signature(function)
    shown = [
        parameter.replace(
            annotation=_Verbatim(parameter.annotation),
            default=_Verbatim("{}")
            if isinstance(parameter.default, Mapping) or "factory" in repr(parameter.default)
            else parameter.default,
        )
        for parameter in signature.parameters.values()
        if parameter.name != "self"
    ]
    text = signature.replace(parameters=shown, return_annotation=inspect.Signature.empty)
    returned = signature.return_annotation
    return f"{name}{text}" + (f" -> {returned}" if returned not in (None, "None") else "")


def _code(signature: str) -> str:
    """Return a signature as code, with one parameter per line if it is long."""
    if len(signature) > 100:
        head, _, rest = signature.partition("(")
        inner, _, tail = rest.rpartition(")")
        lines = "".join(f"    {argument},\n" for argument in _split(inner))
        signature = f"{head}(\n{lines}){tail}"
    return f"```text\n{signature}\n```"


def _split(parameters: str) -> list[str]:
    """Return the parameters one by one, split at commas outside brackets."""
    parts, depth = [""], 0
    for character in parameters:
        depth += (character in "[(") - (character in "])")
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def _text(value: Any) -> str:
    return (inspect.getdoc(value) or "").replace("``", "`").replace("::\n\n", "")
