"""``trunk simulate``: a run without ROS, into the same kind of recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .common import plan_of, plan_options


@click.command("simulate")
@plan_options
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The MCAP file to write.",
)
@click.option("--force", is_flag=True, help="Replace the file where it exists.")
def command(output: Path, force: bool, **options: Any) -> None:
    """Run SCENARIO without ROS: same functions, files, topics and schemas.

    SCENARIO is fig6, fig7, fig8, fig9, demo, or the path of a parameter file.
    """
    from ..offline_recording import record_offline

    plan = plan_of(**options)
    states = record_offline(plan, output, overwrite=force)
    click.echo(f"{output}: {states} states, {plan.scenario}, {plan.controller_name}")
