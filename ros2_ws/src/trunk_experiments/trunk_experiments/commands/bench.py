"""``trunk bench``: speed as ratios, both sides measured in one run."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

import click

from .common import print_table


@click.group("bench")
def command() -> None:
    """Measure speed, as ratios in one run."""


@command.command("core")
@click.option("--rounds", default=7, show_default=True, help="Rounds, of which the median counts.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def core(rounds: int, as_json: bool) -> None:
    """One fuzzy evaluation against pyfuzzylite's, one PID update against simple-pid's."""
    from ..bench_core import bench_core

    rows = bench_core(rounds)
    if as_json:
        click.echo(json.dumps([asdict(row) for row in rows], indent=2))
    else:
        print_table(
            f"median of {rounds} rounds, side by side",
            ("what", "ours, us", "theirs, us", "ratio", "goal", ""),
            [
                (
                    row.name,
                    f"{row.ours_s * 1e6:.3g}",
                    f"{row.theirs_s * 1e6:.3g}",
                    f"{row.ratio:.3g}",
                    row.goal,
                    "" if row.met is None else "met" if row.met else "MISSED",
                )
                for row in rows
            ],
        )
    sys.exit(0 if all(row.met is not False for row in rows) else 1)
