"""Plug-ins: objects that installed packages register as entry points, such as control laws and plants."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from .errors import TrunkError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class Registered(Protocol):
    """An object that has the name of its entry point."""

    @property
    def name(self) -> str:
        """Its name."""


Plugin = TypeVar("Plugin", bound=Registered)
LAW_GROUP, PLANT_GROUP = "trunk.controllers", "trunk.plants"  # of entry points
_NAME = re.compile(r"[a-z][a-z0-9_]*")


class PluginError(TrunkError):
    """A registered plug-in cannot be used."""


class Registry(Generic[Plugin]):
    """The plug-ins of a group of entry points ``NAME = MODULE:OBJECT``.

    ``noun``: what one is, in messages. ``type_of``: returns the class that it needs. ``first``: ours, in the
    order of tables and plots; others follow by name.
    """

    def __init__(
        self, group: str, noun: str, type_of: Callable[[], type[Plugin]], first: Sequence[str]
    ) -> None:
        self._group, self._noun, self._type_of = group, noun, type_of
        self._rank = {name: rank for rank, name in enumerate(first)}
        self._loaded: dict[str, Plugin] = {}

    @cached_property
    def _entries(self) -> dict[str, list[EntryPoint]]:
        from importlib.metadata import entry_points  # slow to import

        entries: dict[str, list[EntryPoint]] = {}
        for entry in entry_points(group=self._group):
            entries.setdefault(entry.name, []).append(entry)
        last = len(self._rank)
        order = sorted(entries, key=lambda name: (self._rank.get(name, last), name))
        return {name: entries[name] for name in order}

    @property
    def names(self) -> tuple[str, ...]:
        """The registered names."""
        return tuple(self._entries)

    def package_of(self, name: str) -> str:
        """Return the package that registered a name."""
        return _package(self._entries[name][0])

    def named(self, name: str) -> Plugin:
        """Return a plug-in.

        Raises KeyError for a name that is not registered, PluginError for what cannot be used.
        """
        if name not in self._loaded:
            self._loaded[name] = self._load(name)
        return self._loaded[name]

    def _load(self, name: str) -> Plugin:
        entries = sorted(self._entries[name], key=_package)  # a folder lists them in any order
        by = " and ".join(f"package {_package(entry)} ({entry.value})" for entry in entries)
        subject = f"{self._noun} {name!r} of {by}"
        if len(entries) > 1:
            raise PluginError(
                f"{subject}: only one may have this name: uninstall or rename the other"
            )
        if not _NAME.fullmatch(name):
            raise PluginError(
                f"{subject}: a name of lowercase letters, digits and underscores is needed"
            )
        try:
            loaded: Any = entries[0].load()
        except (Exception, SystemExit) as error:  # another project's module may raise anything
            reason = " ".join(str(error).split())
            raise PluginError(
                f"{subject} cannot be loaded: {type(error).__name__}: {reason}"
            ) from error
        needed = self._type_of()
        if not isinstance(loaded, needed):
            kind = f"{needed.__module__}.{needed.__name__}"
            raise PluginError(f"{subject} is {type(loaded).__name__}: a {kind} is needed")
        if loaded.name != name:
            kind = needed.__name__.lower()
            raise PluginError(
                f"{subject} calls itself {loaded.name!r}: entry point and {kind} need the same name"
            )
        return loaded


def _package(entry: EntryPoint) -> str:
    """Return the name of the package, as ROS 2 spells it."""
    return entry.dist.name.replace("-", "_") if entry.dist else "unknown"
