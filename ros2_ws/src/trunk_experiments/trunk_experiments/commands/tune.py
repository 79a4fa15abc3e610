"""``trunk tune``: gains for a plant, their margins, and the parameter file that the nodes load."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf, radians
from typing import TYPE_CHECKING, Any

import click
from rich.progress import BarColumn, Progress, TextColumn

from trunk_control.pid import Gains
from trunk_msgs_util.parameters.declarations import Value, build, values_of
from trunk_msgs_util.parameters.files import write

from ..analysis.metrics import Metrics
from ..console.common import FiniteRange, Function, Name
from ..console.outputs import check_output, output_options
from ..console.tables import print_table
from ..console.terminal import console
from ..plans.nodes import CONTROLLERS, NODES
from ..plans.plan import RunPlan, make_plan
from .margins import print_margins

if TYPE_CHECKING:
    from ..tuning.linear import Linear

_METRICS = tuple(name for name in Metrics.__dataclass_fields__ if not name.startswith("theta"))


def _options(function: Any) -> Any:
    """Add the options of every method: plant, profile, rate, and the output file."""
    options = [
        output_options("The ROS 2 parameter file to write, for --params or --params-file."),
        click.option(
            "--params",
            multiple=True,
            metavar="FILE",
            help="Plant, profile: a parameter file, by path or shipped name; repeatable.",
        ),
        click.option(
            "--set",
            "settings",
            multiple=True,
            metavar="NODE.PARAM=VALUE",
            help="One value; repeatable.",
        ),
        click.option(
            "--rate",
            type=FiniteRange(0.001, 1e6, unit="Hz"),
            metavar="HZ",
            help="update_rate of the sampled loop, Hz.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def _largest(name: str, default: float, text: str, unit: str) -> Callable[[Function], Function]:
    """Add an option for a largest acceptable value; its range keeps the Riccati equation solvable."""
    kind = FiniteRange(1e-6, 1e6, unit=unit)
    return click.option(
        name, type=kind, default=default, show_default=True, help=f"{text}, {unit}."
    )


def _plan(
    controller: str,
    params: tuple[str, ...],
    settings: tuple[str, ...],
    rate: float | None,
    scenario: str = "fig6",
) -> RunPlan:
    everywhere = {} if rate is None else {"update_rate": rate}
    return make_plan(scenario, controller, ("profile_practical", *params), settings, everywhere)


@click.group("tune")
def command() -> None:
    """Compute gains, report their margins, and write them as a parameter file that the nodes load.

    poles, lqr and relay use the trunk linearised about the upright, with a prescribed hip; optimise uses
    whole runs of the nonlinear plant. The profile is profile_practical unless --params gives another.
    """


@command.command("poles")
@_options
@click.option("--controller", type=click.Choice(["pid", "computed_torque"]), default="pid")
@click.option(
    "--pole",
    "poles",
    multiple=True,
    type=FiniteRange(-1e6, 0.0, max_open=True, unit="1/s"),
    metavar="1/S",
    help="Two or three, distinct, negative.",
)
def poles_command(controller: str, poles: tuple[float, ...], **options: Any) -> None:
    """Place the poles of the loop, by default at -12, -8 and -2."""
    from ..tuning.methods import by_poles

    plan, plant = _linear(controller, options)
    if controller == "computed_torque":
        plant = plant._replace(a=0.0, b=1.0)  # what is left after inverse dynamics
    _finish(plan, by_poles(plant, poles or (-12.0, -8.0, -2.0)), options)


@command.command("lqr")
@_options
@_largest("--integral", 0.1, "Largest integral of the error", "rad s")
@_largest("--angle", 6.0, "Largest error", "deg")
@_largest("--speed", 1.0, "Largest rate of the error", "rad/s")
@_largest("--torque", 5.0, "Largest torque", "N m")
def lqr_command(integral: float, angle: float, speed: float, torque: float, **options: Any) -> None:
    """Solve the Riccati equation; weights are one over the square of the largest acceptable values."""
    from ..tuning.methods import by_lqr

    plan, plant = _linear("lqr", options)
    gains = by_lqr(plant, integral, radians(angle), speed, torque)
    _finish(plan, gains, options, {"model.gravity_torque": plant.a / plant.b})


@command.command("relay")
@_options
@click.option(
    "--lag",
    type=FiniteRange(0.0, 1e3, unit="s"),
    required=True,
    help="Declared time constant of the actuator, s.",
)
@click.option(
    "--damping",
    type=FiniteRange(0.0, 1e9, unit="N m s/rad"),
    required=True,
    help="Declared damping of the joint, N m s/rad.",
)
@click.option(
    "--amplitude",
    type=FiniteRange(1e-6, 1e6, unit="N m"),
    default=1.0,
    show_default=True,
    help="Amplitude of the relay, N m.",
)
def relay_command(lag: float, damping: float, amplitude: float, **options: Any) -> None:
    """Find Ku and Tu by a relay experiment, then Table 1's PID; an error where no ultimate gain exists.

    The plant itself has neither lag nor damping, and thus no ultimate gain: declare both here; the margins
    are those of the loop with them.
    """
    from ..tuning.methods import relay, ziegler_nichols

    plan, plant = _linear("pid", options)
    plant = plant._replace(c=damping * plant.b, lag=lag)
    found = relay(plant, amplitude)
    print_table(
        "relay experiment",
        ("quantity", "relay", "Routh", "unit"),
        [
            ("Ku", f"{found.gain:.5g}", f"{found.exact_gain:.5g}", "N m/rad"),
            ("Tu", f"{found.period:.5g}", f"{found.exact_period:.5g}", "s"),
            ("amplitude", f"{found.amplitude:.5g}", "", "rad"),
        ],
    )
    _finish(plan, ziegler_nichols(found.gain, found.period), options, plant=plant)


@command.command("optimise")
@_options
@click.option("--controller", type=Name(CONTROLLERS), default="pid", show_default=True)
@click.option("--scenario", "scenarios", multiple=True, default=("fig6", "fig7"), show_default=True)
@click.option("--metric", type=click.Choice(_METRICS), default="itae", show_default=True)
@click.option("--generations", type=click.IntRange(1, 100_000), default=20, show_default=True)
@click.option("--population", type=click.IntRange(1, 1000), default=5, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=1, show_default=True)
def optimise_command(
    controller: str,
    scenarios: tuple[str, ...],
    metric: str,
    generations: int,
    population: int,
    seed: int,
    **options: Any,
) -> None:
    """Search for the smallest mean of a metric over scenarios, by seeded differential evolution.

    For pid it searches the gains; for fuzzy_pid the ranges of the gains, both universes and all three
    rule tables, symmetric in e and its rate; for any other controller all numbers of its own.
    """
    from ..tuning.search import search

    _check(options)
    plan = partial(_plan, controller, options["params"], options["settings"], options["rate"])
    with Progress(
        TextColumn("generation {task.completed} of {task.total}"),
        BarColumn(),
        TextColumn("best {task.fields[best]:.5g}"),
        console=console(stderr=True),
        transient=True,
    ) as progress:
        task = progress.add_task("", total=generations, best=inf)
        found = search(
            [plan(scenario) for scenario in scenarios],
            metric,
            generations,
            population,
            seed,
            lambda done, best: progress.update(task, completed=done, best=best),
        )
    click.echo(
        f"{metric}, mean over {', '.join(scenarios)}: {found.start_cost:.6g} before, "
        f"{found.cost:.6g} after {found.runs} runs (seed {seed})"
    )
    _write(plan(scenarios[0]), found.values, options)


def _linear(controller: str, options: dict[str, Any]) -> tuple[RunPlan, Linear]:
    from ..tuning.linear import linearise

    _check(options)
    plan = _plan(controller, options["params"], options["settings"], options["rate"])
    return plan, linearise(plan.simulator.body)


def _check(options: dict[str, Any]) -> None:
    if options["output"] is not None:
        check_output(options["output"], (".yaml", ".yml"), options["force"], options["params"])


def _finish(
    plan: RunPlan,
    gains: Gains,
    options: dict[str, Any],
    others: dict[str, Value] | None = None,
    plant: Linear | None = None,
) -> None:
    values: dict[str, Value] = {f"gains.{n}": getattr(gains, n) for n in "pid"}
    _write(plan, {**values, **(others or {})}, options, plant)


def _write(
    plan: RunPlan, values: dict[str, Value], options: dict[str, Any], plant: Linear | None = None
) -> None:
    """Print the gains and their margins and write the file; refuse what the node would refuse."""
    name = plan.controller_name
    config = build(NODES[name].config, {**values_of(plan.controller), **values})
    print_table(
        name,
        ("parameter", "value"),
        [
            (key, f"{value:.6g}" if isinstance(value, float) else str(value))
            for key, value in values.items()
        ],
    )
    print_margins(plan, config, plant)
    if options["output"] is not None:
        write(options["output"], {name: values})
        click.echo(f"{options['output']}: for --params, or ros2 run … --ros-args --params-file")
