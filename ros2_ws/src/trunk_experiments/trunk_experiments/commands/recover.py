"""``trunk recover``: a valid file from a broken one."""

from __future__ import annotations

from pathlib import Path

import click

from trunk_msgs_util.recording.recover import recover

from ..console.outputs import check_output, output_options


@click.command("recover")
@click.argument("broken", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@output_options("The MCAP file to write.", required=True)
@click.pass_context
def command(context: click.Context, broken: Path, output: Path, force: bool) -> None:
    """Write a finished, indexed file with everything that can be read from a broken one.

    The new file is marked as recovered and never passes for a complete run.

    Exit code: 0 nothing was lost, 1 something was lost, 2 nothing can be read.
    """
    check_output(output, (".mcap",), force, [broken])
    recovery = recover(broken, output, force)
    for line in recovery.lost:
        click.echo(f"lost: {line}")
    click.echo(f"{output}: {recovery.count} messages of {len(recovery.messages)} topics")
    context.exit(1 if recovery.lost else 0)
