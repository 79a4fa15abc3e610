"""``python -m benchmarks NAME``: a table or, with --json, a document; exit code 1 if a goal was missed."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import click

from trunk_core.errors import TrunkError
from trunk_experiments.console.tables import print_table
from trunk_msgs_util.node import middleware

from . import core, gpu, gym, lanes, nodes, read, sweep
from .harness import Row

BENCHMARKS: dict[str, Callable[..., list[Row]]] = {
    "core": core.compare,
    "lanes": lanes.compare,
    "sweep": sweep.compare,
    "gym": gym.compare,
    "gpu": gpu.compare,
    "read": read.compare,
    "lockstep": nodes.lockstep,
    "realtime": nodes.realtime,
    "live": nodes.live,
    "external": nodes.external,
}
_WORDS = {None: "", True: "met", False: "MISSED"}


def _command(name: str, compare: Callable[..., list[Row]]) -> click.Command:
    """Return the command of a benchmark: what it takes are the function's parameters."""

    def run(as_json: bool, **given: Any) -> None:
        rows = compare(**given)
        if as_json:
            document = {"benchmark": name, "rows": [asdict(row) for row in rows]}
            click.echo(json.dumps(document, indent=2, ensure_ascii=False))
        else:
            print_table(
                f"{name}: medians of {given['rounds']} rounds, side by side",
                ("what", "ours", "theirs", "", "ratio", "goal", ""),
                [
                    (
                        *(row.name, f"{row.ours:.4g}", f"{row.theirs:.4g}", row.unit),
                        "" if row.ratio is None else f"{row.ratio:.3g}",
                        *(row.goal, _WORDS[row.met]),
                    )
                    for row in rows
                ],
            )
        sys.exit(any(row.met is False for row in rows))

    parameters: list[click.Parameter] = []
    for one in inspect.signature(compare).parameters.values():
        if one.default is inspect.Parameter.empty:
            parameters.append(click.Argument([one.name]))
            continue
        kind: Any = click.STRING
        if isinstance(one.default, int | float):
            whole = isinstance(one.default, int)
            kind = click.IntRange(1) if whole else click.FloatRange(0.0, 1e5, min_open=True)
        parameters.append(
            click.Option([f"--{one.name}"], type=kind, default=one.default, show_default=True)
        )
    parameters.append(click.Option(["--json", "as_json"], is_flag=True))
    return click.Command(name, callback=run, params=parameters, help=inspect.getdoc(compare))


@click.group(commands={name: _command(name, compare) for name, compare in BENCHMARKS.items()})
def main() -> None:
    """Measure speed as ratios, both sides in the same run."""


if __name__ == "__main__":
    try:
        middleware.prepare()
        main(prog_name="python -m benchmarks")
    except TrunkError as error:
        print(f"benchmarks: error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
