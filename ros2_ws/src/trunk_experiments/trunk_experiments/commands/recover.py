"""``trunk recover``: a valid file from a broken one."""

from __future__ import annotations

from pathlib import Path

import click

from trunk_msgs_util.recording.recover import recover

from ..console.document import json_option, write_json
from ..console.outputs import check_output, output_options
from ..console.reading import written_values


@click.command("recover")
@click.argument("broken", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@output_options("The MCAP file to write.", required=True)
@json_option("recover-1")
@click.pass_context
def command(context: click.Context, broken: Path, output: Path, force: bool, as_json: bool) -> None:
    """Write a finished, indexed file with everything that can be read from a broken one.

    The new file is marked as recovered and never passes for a complete run.

    Exit code: 0 nothing was lost, 1 something was lost, 2 nothing can be read.
    """
    check_output(output, (".mcap",), force, [broken])
    recovery = recover(broken, output, force)
    if as_json:
        saved = {"messages": recovery.messages, "lost": recovery.lost}
        write_json("recover-1", {"from": broken, **written_values(output), **saved})
    else:
        for line in recovery.lost:
            click.echo(f"lost: {line}")
        click.echo(f"{output}: {recovery.count} messages of {len(recovery.messages)} topics")
    context.exit(1 if recovery.lost else 0)
