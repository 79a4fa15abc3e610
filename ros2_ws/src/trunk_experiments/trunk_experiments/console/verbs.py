"""A verb with subcommands: its help shows their first sentences in full."""

from __future__ import annotations

import click

from ..errors import PlanError
from ..suggestions import did_you_mean

_WHOLE = 10_000  # characters of a first sentence; click would cut it at the line's end


class Verbs(click.Group):
    """A group that lists its commands if an unknown one is given."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command of a given name. Raises PlanError if there is none."""
        name = args[0]
        if self.get_command(ctx, name) is None and not ctx.resilient_parsing:
            commands = self.list_commands(ctx)
            raise PlanError(
                f"trunk {self.name} {name!r}: give one of {', '.join(commands)}{did_you_mean(name, commands)}"
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write each command's name and first sentence."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, found.get_short_help_str(_WHOLE)) for name, found in commands if found]
            )
