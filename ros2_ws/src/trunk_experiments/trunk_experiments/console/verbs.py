"""Verbs that have verbs of their own, such as ``trunk study``."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from trunk_core.errors import PlanError, did_you_mean

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_WHOLE = 10_000  # characters of a first sentence; click would cut it at the line's end


class Verbs(click.Group):
    """A group that lists its verbs if an unknown one is given, and of an old one what does its work now."""

    def __init__(self, *args: Any, gone: Mapping[str, str] | None = None, **kwargs: Any) -> None:
        """``gone``: what is typed now, by the old verb."""
        super().__init__(*args, **kwargs)
        self.gone = gone or {}

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the verb of a given name. Raises PlanError if there is none."""
        if self.get_command(ctx, args[0]) is None and not ctx.resilient_parsing:
            raise PlanError(self.unknown(ctx, args[0]))
        return super().resolve_command(ctx, args)

    def unknown(self, ctx: click.Context, name: str) -> str:
        """Return the error for a name that no verb has."""
        if name in self.gone:
            words = f"trunk {self.name}".replace("trunk trunk", "trunk")
            return f"{words} {name} is now: {self.gone[name]}"
        verbs = self.list_commands(ctx)
        known = ", ".join(verbs)
        return f"trunk {self.name} {name!r}: give one of {known}{did_you_mean(name, verbs)}"

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write each verb's name and line."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self.lines(ctx).items()))

    def lines(self, ctx: click.Context) -> Mapping[str, str]:
        """Return each verb's line for the overview: the first sentence of its help."""
        commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        return {name: verb.get_short_help_str(_WHOLE) for name, verb in commands.items() if verb}


class OrderedVerbs(Verbs):
    """Verbs in the order in which they are defined."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


class LazyVerbs(Verbs):
    """Verbs with a module each, in ``package``, that is imported only when the verb is called.

    Help and completion need the ``overview`` alone: each verb's line. ``modules`` has those that do not have
    their verb's name.
    """

    def __init__(
        self,
        *args: Any,
        package: str,
        overview: Mapping[str, str],
        modules: Mapping[str, str] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, **kwargs)
        self._package, self._overview, self._modules = package, overview, modules or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self._overview)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self._overview:
            return None
        module = import_module(f"{self._package}.{self._modules.get(cmd_name, cmd_name)}")
        command: click.Command = module.command
        return command

    def lines(self, ctx: click.Context) -> Mapping[str, str]:
        return self._overview

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete verbs, and options as any command does."""
        from click.shell_completion import CompletionItem

        verbs = [name for name in self.list_commands(ctx) if name.startswith(incomplete)]
        options = click.Command.shell_complete(self, ctx, incomplete)
        return [*(CompletionItem(name, help=self._overview[name]) for name in verbs), *options]
