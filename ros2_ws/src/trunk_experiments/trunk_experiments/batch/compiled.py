"""Compiled twins of pure functions: the same code objects, compiled by numba, nothing written twice.

A twin is made of a function and of all functions of this project that it calls, found through its
global names, each bound to the others' twins. Compiled code gives the bits of CPython: no fast-math,
no fused multiply-add, sines from the same C library. What differs is how trouble shows: a division by
zero or a sine of infinity gives inf or NaN where CPython raises.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

import numba

_OURS = ("trunk_msgs_util", "trunk_sim", "trunk_control", "trunk_experiments")
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function, name: str = "", **bindings: Callable[..., Any]) -> Function:
    """Return the compiled twin of a function; it compiles at its first call, or comes from disk.

    ``bindings`` replace functions that its module knows by a global name; a twin with bindings needs a
    ``name`` of its own. The machine code is kept in `cache_folder`.
    """
    if bindings and not name:
        raise ValueError("a twin with bindings needs a name")
    copies = _copies(function, bindings)
    twins: dict[Any, Any] = {  # inline: passing rule tables by value costs as much as using them
        original: numba.njit(copy, forceinline=True, **_OPTIONS)
        for original, copy in copies.items()
        if original is not function
    }
    for copy in copies.values():
        for label, value in list(copy.__globals__.items()):
            if isinstance(value, FunctionType) and value in twins:
                copy.__globals__[label] = twins[value]
    top = copies[cast(FunctionType, function)]
    top.__name__ = top.__qualname__ = name or top.__name__
    return cast(Function, _cached(top, fingerprint(function, **bindings)))


def fingerprint(function: Callable[..., Any], **bindings: Callable[..., Any]) -> str:
    """Return a hash of the source files that a twin is made of and of numba's version."""
    names = {Path(__file__)}  # the options are a part of it
    names |= {Path(original.__code__.co_filename) for original in _copies(function, bindings)}
    digest = hashlib.sha256(version("numba").encode())
    for path in sorted(names, key=lambda path: (path.name, str(path))):
        digest.update(_contents(path))
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Return the folder of compiled code: ``$XDG_CACHE_HOME/trunk``, else ``~/.cache/trunk``."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "trunk"


@cache
def _contents(path: Path) -> bytes:
    return path.read_bytes()


def _copies(function: Any, bindings: dict[str, Any]) -> dict[FunctionType, FunctionType]:
    """Return copies, with namespaces of their own, of a function and of all of ours that it calls."""
    found: dict[FunctionType, FunctionType] = {}
    waiting = [function]
    while waiting:
        original = waiting.pop()
        if original in found:
            continue
        bound = bindings if original.__module__ == function.__module__ else {}
        namespace = {**original.__globals__, **bound}
        found[original] = FunctionType(
            original.__code__, namespace, original.__name__, original.__defaults__
        )
        for label in _names(original.__code__):
            value = namespace.get(label)
            if isinstance(value, FunctionType) and value.__module__.split(".")[0] in _OURS:
                waiting.append(value)
    return found


def _names(code: CodeType) -> tuple[str, ...]:
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return (*code.co_names, *(name for one in inner for name in _names(one)))


def _cached(top: FunctionType, key: str) -> Any:
    """Return the function's dispatcher, cached under a key; uncached where no folder can be written.

    Numba's own cache looks at the age of one source file, but a twin is made of several: each set of
    sources has a folder to itself.
    """
    config: Any = numba.config
    folder = config.CACHE_DIR
    config.CACHE_DIR = str(cache_folder() / key)
    try:
        return numba.njit(top, cache=True, **_OPTIONS)
    except (RuntimeError, OSError):
        return numba.njit(top, **_OPTIONS)
    finally:
        config.CACHE_DIR = folder
