"""``trunk bench``: speed as ratios, both sides measured in the same run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from ..console.document import json_option, write_json
from ..console.options import FiniteRange
from ..console.tables import print_table
from ..console.verbs import Verbs


@click.group("bench", cls=Verbs)
def command() -> None:
    """Measure speed as ratios, both sides in the same run."""


def _rounds(default: int) -> Callable[[Any], Any]:
    return click.option(
        "--rounds",
        type=click.IntRange(1, 1000),
        default=default,
        show_default=True,
        help="Number of rounds; their median is shown.",
    )


def _loop(default_s: float, length: str) -> Callable[[Any], Any]:
    """Return a decorator that adds ``--rate`` and ``--seconds``."""

    def add(function: Any) -> Any:
        for name, kind, default, text in (
            ("--seconds", FiniteRange(0.1, 3600.0, unit="s"), default_s, length),
            ("--rate", FiniteRange(1.0, 1e5, unit="Hz"), 1000.0, "Rate of the loops, Hz."),
        ):
            function = click.option(name, type=kind, default=default, show_default=True, help=text)(
                function
            )
        return function

    return add


def _show(
    rows: Sequence[Any],
    as_json: bool,
    title: str,
    header: tuple[str, ...],
    cells: Callable[[Any], tuple[str, ...]],
) -> None:
    """Print rows of a benchmark, each with its goal; end with exit code 1 if one was missed."""
    if as_json:
        benchmark = click.get_current_context().info_name
        write_json("bench-1", {"benchmark": benchmark, "rows": [asdict(row) for row in rows]})
    else:
        words = {None: "", True: "met", False: "MISSED"}
        print_table(
            title,
            (*header, "goal", ""),
            [(*cells(row), row.goal, words[row.met]) for row in rows],
        )
    sys.exit(0 if all(row.met is not False for row in rows) else 1)


_IN_A_SECOND = {"ns": 1e9, "us": 1e6, "ms": 1e3}


def _show_side_by_side(
    rows: Sequence[Any], as_json: bool, rounds: int, unit: str, ours: str, theirs: str
) -> None:
    """Show rows of two sides, called ``ours`` and ``theirs``, in a unit of time or as rates in 1/s."""
    kind, factor = ("s", _IN_A_SECOND[unit]) if unit in _IN_A_SECOND else ("hz", 1.0)
    sides = f"ours_{kind}", f"theirs_{kind}"
    _show(
        rows,
        as_json,
        f"median of {rounds} rounds, side by side",
        ("what", f"{ours}, {unit}", f"{theirs}, {unit}", "ratio"),
        lambda row: (
            row.name,
            *(f"{value:.3g}" for value in (*(factor * getattr(row, s) for s in sides), row.ratio)),
        ),
    )


def _measured(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".rstrip()


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


@command.command("lockstep")
@_rounds(5)
@click.option(
    "--steps",
    type=click.IntRange(1, 10_000_000),
    default=5000,
    show_default=True,
    help="Steps in each run.",
)
@json_option("bench-1")
def lockstep(rounds: int, steps: int, as_json: bool) -> None:
    """Lock-step loops against a bare pair of rclpy processes that echo the same messages."""
    from ..bench.lockstep import bench_lockstep

    rows = bench_lockstep(rounds, steps)
    _show(
        rows,
        as_json,
        f"median of {rounds} rounds of {steps} steps",
        ("loop", "steps/s", "ratio", "to"),
        lambda row: (row.name, f"{row.rate_hz:.0f}", _ratio(row.ratio), row.against),
    )


@command.command("realtime")
@_rounds(3)
@_loop(10.0, "Length of each measurement.")
@json_option("bench-1")
def realtime(rounds: int, rate: float, seconds: float, as_json: bool) -> None:
    """Jitter and latency in real time against a bare rclpy timer and echo."""
    from ..bench.realtime import bench_realtime

    rows = bench_realtime(rate, seconds, rounds)
    _show(
        rows,
        as_json,
        f"median of {rounds} rounds of {seconds:g} s at {rate:g} Hz",
        ("loop", "measure", "", "ratio"),
        lambda row: (row.loop, row.measure, _measured(row.value, row.unit), _ratio(row.ratio)),
    )


@command.command("external")
@click.argument("node")
@_rounds(3)
@_loop(4.0, "Length of each run.")
@json_option("bench-1")
def external(node: str, rounds: int, rate: float, seconds: float, as_json: bool) -> None:
    """Compare a controller's node of your own, started by the command NODE, with our pid."""
    from ..bench.external import bench_external

    rows = bench_external(node, rounds, rate, seconds)
    _show(
        rows,
        as_json,
        f"median of {rounds} rounds of {seconds:g} s at {rate:g} Hz",
        ("measure", "node", "", "to ours"),
        lambda row: (row.measure, row.loop, _measured(row.value, row.unit), _ratio(row.ratio)),
    )


@command.command("live")
@_rounds(5)
@_loop(10.0, "Length of each measurement.")
@click.option(
    "--pages",
    type=click.IntRange(1, 16),
    default=4,
    show_default=True,
    help="Number of open pages.",
)
@json_option("bench-1")
def live(rounds: int, rate: float, seconds: float, pages: int, as_json: bool) -> None:
    """Latency and missed steps of a loop while pages show it, against the same loop without pages."""
    from ..bench.live import bench_live

    rows = bench_live(rate, seconds, rounds, pages)
    _show(
        rows,
        as_json,
        f"median of {rounds} rounds of {seconds:g} s at {rate:g} Hz, {pages} pages",
        ("measure", "alone", "with pages", "ratio"),
        lambda row: (
            row.measure,
            *(_measured(value, row.unit) for value in (row.alone, row.served)),
            _ratio(row.ratio),
        ),
    )


@command.command("core")
@_rounds(7)
@json_option("bench-1")
def core(rounds: int, as_json: bool) -> None:
    """One fuzzy evaluation against pyfuzzylite's, one PID update against simple-pid's."""
    from ..bench.core import bench_core

    _show_side_by_side(bench_core(rounds), as_json, rounds, "us", "ours", "theirs")


@command.command("read")
@click.argument("run", required=False, type=click.Path(path_type=Path, exists=True))
@_rounds(5)
@click.option(
    "--duration",
    type=FiniteRange(0.1, 1e5, unit="s"),
    default=20.0,
    show_default=True,
    help="Length of the simulated run if RUN is not given, s.",
)
@json_option("bench-1")
def read(run: Path | None, rounds: int, duration: float, as_json: bool) -> None:
    """Compare our reader with rosbags on RUN, or on a simulated run; the arrays must be equal."""
    from ..bench.read import bench_read

    rows = bench_read(rounds, duration, run)
    _show_side_by_side(rows, as_json, rounds, "1/s", "ours", "rosbags")


@command.command("sweep")
@_rounds(3)
@json_option("bench-1")
def sweep(rounds: int, as_json: bool) -> None:
    """Compiled closed-loop runs against MuJoCo's and scikit-fuzzy's; many runs; two cores."""
    from ..bench.sweep import bench_sweep

    _show_side_by_side(bench_sweep(rounds), as_json, rounds, "ms", "ours", "theirs")


@command.command("gym")
@_rounds(5)
@click.option(
    "--envs",
    type=click.IntRange(1, 100_000),
    default=1024,
    show_default=True,
    help="Environments side by side.",
)
@json_option("bench-1")
def gym(rounds: int, envs: int, as_json: bool) -> None:
    """Compare our Gymnasium environment's steps per second per core with CartPole's."""
    from ..bench.gym import bench_gym

    rows = bench_gym(rounds, envs)
    _show_side_by_side(rows, as_json, rounds, "1/s", "ours", "CartPole")


@command.command("export")
@_rounds(7)
@json_option("bench-1")
def export(rounds: int, as_json: bool) -> None:
    """Compare an exported law's update with the same law written by hand in C; the bits must be equal."""
    from ..bench.exported import bench_export

    _show_side_by_side(bench_export(rounds), as_json, rounds, "ns", "exported", "by hand")
