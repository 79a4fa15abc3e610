"""``trunk tune``: gains for a plant, their margins, and the parameter file that the nodes load."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import radians
from typing import TYPE_CHECKING, Any

import click

from trunk_msgs_util.units import seconds

from ...analysis.metrics import RANKED
from ...console.document import json_option
from ...console.options import FiniteRange, Function, WholeRange, exclude, jobs_option
from ...console.outputs import check_output, output_options
from ...console.plan_options import ControllerName, loop_options, loop_plan
from ...console.progress import progress_bar
from ...console.terminal import show_warnings
from ...console.verbs import Verbs
from ...plans.plan import RunPlan
from .result import finish, finish_values, show_relay

if TYPE_CHECKING:
    from ...tuning.linear import Linear


def _options(function: Any) -> Any:
    """Add the options of every method: plant, profile, rate, and the output file."""
    options = [
        output_options("The ROS 2 parameter file to write, for --params or --params-file."),
        loop_options,
        json_option("commands.tune.document:TuneResult"),
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


@click.group("tune", cls=Verbs)
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
    help="A pole; give two or three, distinct and negative.",
)
def poles_command(controller: str, poles: tuple[float, ...], **options: Any) -> None:
    """Place the poles of the loop, by default at -12, -8 and -2."""
    from ...tuning.methods import by_poles

    plan, plant = _linear(controller, options)
    if controller == "computed_torque":
        plant = plant._replace(a=0.0, b=1.0)  # what is left after inverse dynamics
    finish(plan, by_poles(plant, poles or (-12.0, -8.0, -2.0)), options)


@command.command("lqr")
@_options
@_largest("--integral", 0.1, "Largest integral of the error", "rad s")
@_largest("--angle", 6.0, "Largest error", "deg")
@_largest("--speed", 1.0, "Largest rate of the error", "rad/s")
@_largest("--torque", 5.0, "Largest torque", "N m")
@click.option(
    "--discrete",
    is_flag=True,
    help="Solve the discrete equation, for a torque held over each period of update_rate.",
)
def lqr_command(
    integral: float, angle: float, speed: float, torque: float, discrete: bool, **options: Any
) -> None:
    """Solve the Riccati equation; weights are one over the square of the largest acceptable values.

    The equation is that in continuous time, whatever the rate; with --discrete it is that of the sampled
    trunk, with the same cost. At 100 Hz the default gains are 6 to 9 % smaller then.
    """
    from ...tuning.methods import by_lqr

    plan, plant = _linear("lqr", options)
    period = seconds(plan.controller.period_ns) if discrete else 0.0
    gains = by_lqr(plant, integral, radians(angle), speed, torque, period)
    finish(plan, gains, options, {"model.gravity_torque": plant.a / plant.b})


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
    from ...tuning.methods import relay, ziegler_nichols

    plan, plant = _linear("pid", options)
    oscillation = relay(plant._replace(c=damping * plant.b, lag=lag), amplitude)
    if not options["as_json"]:
        show_relay(oscillation)
    gains = ziegler_nichols(oscillation.gain, oscillation.period)
    drive = replace(plan.simulator, actuator_time_constant=lag, viscous_friction=damping)
    finish(replace(plan, simulator=drive), gains, options, how={"relay": oscillation})


@command.command("optimise")
@_options
@click.option("--controller", type=ControllerName(), default="pid", show_default=True)
@click.option("--scenario", "scenarios", multiple=True, default=("fig6", "fig7"), show_default=True)
@click.option("--metric", type=click.Choice(RANKED), default="itae", show_default=True)
@click.option("--generations", type=WholeRange(1, 100_000), default=20, show_default=True)
@click.option(
    "--population",
    type=WholeRange(2, 1000),
    help="Candidates per number searched, 5; with --study candidates, as CMA-ES recommends.",
)
@click.option("--seed", type=WholeRange(0, 2**32 - 1), default=1, show_default=True)
@click.option(
    "--study",
    metavar="FILE",
    help="In place of scenarios: the draws of a study, a file or a shipped one; a fall costs as ten runs.",
)
@click.option(
    "--held-out-seed",
    type=WholeRange(0, 2**31 - 1),
    help="With --study: of the draws by which the result is judged.  [default: the study's + 1]",
)
@jobs_option("With --study: processes on this machine.")
def optimise_command(
    controller: str,
    scenarios: tuple[str, ...],
    metric: str,
    generations: int,
    population: int | None,
    seed: int,
    study: str | None,
    held_out_seed: int | None,
    jobs: int | None,
    **options: Any,
) -> None:
    """Search for the smallest mean of a metric over scenarios, or over the draws of a study.

    For pid it searches the gains; for fuzzy_pid the ranges of the gains, both universes and all three
    rule tables, symmetric in e and its rate; for any other controller, all of its own numbers.
    """
    from ...tuning.search import search
    from .document import SearchResult

    _check(options)
    searched = {
        "metric": metric,
        "generations": generations,
        "population": population,
        "seed": seed,
    }
    if study is not None:
        own = "scenarios", "params", "settings", "rate"
        exclude("--study has its own scenario, parameters and rate", *own)
        _learn(study, controller, searched, held_out_seed, jobs, options)
        return
    plan = partial(loop_plan, controller, options["params"], options["settings"], options["rate"])
    with progress_bar("generations") as tell:
        optimum = search(
            [plan(scenario) for scenario in scenarios],
            metric,
            generations,
            population or 5,
            seed,
            lambda done, best: tell(done, generations, f"best {best:.5g}"),
        )
    if not options["as_json"]:
        click.echo(
            f"{metric}, mean over {', '.join(scenarios)}: {optimum.before:.6g} before, "
            f"{optimum.after:.6g} after {optimum.runs} runs (seed {seed})"
        )
    outcome = SearchResult(metric, scenarios, optimum.before, optimum.after, optimum.runs, seed)
    finish_values(plan(scenarios[0]), optimum.values, options, how={"search": outcome})


def _learn(
    name: str,
    controller: str,
    searched: dict[str, Any],
    held_out_seed: int | None,
    jobs: int | None,
    options: dict[str, Any],
) -> None:
    """Search on a study's draws; print and write what it gave, with what it does on other draws."""
    from ...batch.workers import cores
    from ...study.learning import learn
    from ...study.study import read_study
    from .document import SearchResult
    from .learned import show, study_result

    study = read_study(name)
    other = study.seed + 1 if held_out_seed is None else held_out_seed
    generations = searched["generations"]
    with progress_bar("generations") as tell:
        learned = learn(
            study, controller, **searched,
            held_out_seed=other,
            jobs=jobs or cores(),
            progress=lambda done, best: tell(done, generations, f"best {best:.5g}"),
        )  # fmt: skip
    metric, seed = searched["metric"], searched["seed"]
    if not options["as_json"]:
        click.echo(
            f"{metric}, mean over {study.runs} draws of {name}, a fall as {learned.fall_costs:.4g}: "
            f"{learned.before:.6g} before, {learned.after:.6g} after {learned.runs} runs (seed {seed})"
        )
        show(learned, metric, other)
    outcome = SearchResult(
        metric, [learned.plan.scenario], learned.before, learned.after, learned.runs, seed
    )
    how = {"search": outcome, "study": study_result(learned, name, metric, other)}
    finish_values(learned.plan, learned.values, options, how=how)


def _linear(controller: str, options: dict[str, Any]) -> tuple[RunPlan, Linear]:
    from ...tuning.linear import linearise

    _check(options)
    plan = loop_plan(controller, options["params"], options["settings"], options["rate"])
    show_warnings((*plan.warnings, *_without_effect(controller, options["settings"])))
    return plan, linearise(plan.simulator.body)


def _without_effect(controller: str, settings: Sequence[str]) -> Iterator[str]:
    """Yield a warning for each setting that has no effect on the gains of the linearised trunk."""
    for setting in settings:
        node, _, rest = setting.partition("=")[0].partition(".")
        if node == controller and rest.startswith("gains."):
            yield f"--set {setting}: no effect: this verb computes the gains"
        elif node in ("recorder", "disturbance") or rest.startswith(("initial.", "path.")):
            yield (
                f"--set {setting}: no effect: nothing is run; the trunk is linearised about the upright, on "
                "level ground"
            )


def _check(options: dict[str, Any]) -> None:
    if options["output"] is not None:
        check_output(options["output"], (".yaml", ".yml"), options["force"], options["params"])
