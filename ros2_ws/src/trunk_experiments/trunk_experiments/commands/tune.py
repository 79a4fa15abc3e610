"""``trunk tune``: gains for a plant, their margins, and the parameter file that the nodes load."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import isfinite, radians
from typing import TYPE_CHECKING, Any

import click

from trunk_control.rule_base import RuleBaseConfig
from trunk_control.rule_tables import is_table
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import Value, changed, values_of
from trunk_core.parameters.parameter_files import Layer, write
from trunk_evidence.parameter_text import change_grid, differing_texts, value_text
from trunk_evidence.run_metrics import RANKED
from trunk_runs.plan import RunPlan, advice
from trunk_runs.scenario import plant_of_run

from ..console.document import json_option, write_json
from ..console.options import (
    ControllerName,
    FiniteRange,
    Option,
    WholeRange,
    check_output,
    exclude,
    jobs_option,
    loop_options,
    loop_plan,
    output_options,
    together,
)
from ..console.tables import print_table
from ..console.terminal import progress_bar, show_warnings
from ..console.verbs import Verbs
from .margins import margin_warnings, print_margins

if TYPE_CHECKING:
    from trunk_studies.learning import Learned
    from trunk_studies.statistics import PairedDifference
    from trunk_studies.tuning.methods import Relay

    from ..console.tune_document import StudySearchResult


# Of every method: plant, profile, rate, and the output file.
_options = together(
    output_options("The ROS 2 parameter file to write, for --params or --params-file."),
    loop_options,
    json_option("trunk_experiments.console.tune_document:TuneResult"),
)


def _of_plant(unit: str) -> Callable[[Mapping[str, Any]], str]:
    """Return a function of given options that returns a unit of the trunk's as their plant has it."""

    def chosen(given: Mapping[str, Any]) -> str:
        plant = plant_of_run(
            Layer("", ()), *(given.get(name, ()) for name in ("params", "settings"))
        )
        return re.sub(r"^m\b", plant.coordinates[0].unit, plant.of_drive(unit))

    return chosen


def _largest(name: str, default: float, text: str, unit: str) -> Option:
    """Add an option for a largest acceptable value; its range keeps the Riccati equation solvable."""
    kind = FiniteRange(1e-6, 1e6, unit=_of_plant(unit))
    words = f"{text}, {unit}{' on the trunk' if 'm' in unit else ''}."
    return click.option(name, type=kind, default=default, show_default=True, help=words)


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
    from trunk_studies.tuning.methods import pole_gains

    plan = _plan(controller, options)
    _finish(plan, pole_gains(plan, poles) if poles else pole_gains(plan), options)


@command.command("lqr")
@_options
@click.option("--controller", type=click.Choice(["lqr", "state_feedback"]), default="lqr")
@_largest("--integral", 0.1, "Of lqr: largest integral of the error", "rad s")
@_largest("--angle", 6.0, "Largest error", "deg")
@_largest("--speed", 1.0, "Largest rate of the error", "rad/s")
@_largest("--position", 0.3, "Of state_feedback: largest position of the other coordinate", "m")
@_largest("--velocity", 1.0, "Of state_feedback: largest rate of the other coordinate", "m/s")
@_largest("--torque", 5.0, "Largest torque", "N m")
@click.option(
    "--discrete",
    is_flag=True,
    help="Solve the discrete equation, for a torque held over each period of update_rate.",
)
def lqr_command(
    controller: str,
    integral: float,
    angle: float,
    speed: float,
    position: float,
    velocity: float,
    torque: float,
    discrete: bool,
    **options: Any,
) -> None:
    """Solve the Riccati equation; weights are one over the square of the largest acceptable values.

    The equation is that in continuous time, whatever the rate; with --discrete it is that of the sampled
    trunk, with the same cost. At 100 Hz the default gains are 6 to 9 % smaller then. The controller lqr holds
    the angle, with an integral; state_feedback both coordinates, without one: the hip is passive then.
    """
    from trunk_studies.tuning.methods import RICCATI

    largest = {"angle": radians(angle), "speed": speed, "torque": torque}
    if controller == "lqr":
        exclude("lqr holds the angle alone", "position", "velocity")
        largest["integral"] = integral
    else:
        exclude("the gains of state_feedback are without an integral", "integral")
        largest |= {"position": position, "velocity": velocity}
    plan = _plan(controller, options)
    unknown, remedy = ("delays", "") if discrete else ("the rate and delays", ", or --discrete")
    unstable = f"the loop is unstable: the gains are made without {unknown}: give less for --torque{remedy}"
    values = RICCATI[controller](plan, **largest, discrete=discrete)
    _finish(plan, values, options, unstable=unstable)


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
    type=FiniteRange(0.0, 1e9, unit=_of_plant("N m s/rad")),
    required=True,
    help="Declared damping of the joint, N m s/rad on the trunk.",
)
@click.option(
    "--amplitude",
    type=FiniteRange(1e-6, 1e6, unit=_of_plant("N m")),
    default=1.0,
    show_default=True,
    help="Amplitude of the relay, N m on the trunk.",
)
def relay_command(lag: float, damping: float, amplitude: float, **options: Any) -> None:
    """Find Ku and Tu by a relay experiment, then Table 1's PID; an error where no ultimate gain exists.

    The plant itself has neither lag nor damping, and thus no ultimate gain: declare both here; the margins
    are those of the loop with them.
    """
    from trunk_studies.tuning.linear import linearise
    from trunk_studies.tuning.methods import gain_values, relay, ziegler_nichols

    plan = _plan("pid", options)
    plant = linearise(plan.simulator)
    oscillation = relay(plant._replace(c=damping * plant.b, lag=lag), amplitude)
    if not options["as_json"]:
        _show_relay(oscillation, plan.simulator.kind.of_drive("N m/rad"))
    gains = gain_values(ziegler_nichols(oscillation.gain, oscillation.period))
    drive = replace(plan.simulator, actuator_time_constant=lag, viscous_friction=damping)
    _finish(replace(plan, simulator=drive), gains, options, {"relay": oscillation})


@command.command("optimise")
@_options
@click.option("--controller", type=ControllerName(), default="pid", show_default=True)
@click.option("--scenario", "scenarios", multiple=True, default=("fig6", "fig7"), show_default=True)
@click.option("--metric", type=click.Choice(RANKED), default="itae", show_default=True)
@click.option("--generations", type=WholeRange(1, 100_000), default=20, show_default=True)
@click.option(
    "--population",
    type=WholeRange(2, 1000),
    help="Candidates in a generation.  [default: as CMA-ES recommends]",
)
@click.option("--seed", type=WholeRange(0, 2**32 - 1), default=1, show_default=True)
@click.option(
    "--study",
    metavar="FILE",
    help="In place of scenarios: the draws of a study, a file or a shipped one.",
)
@click.option(
    "--held-out-seed",
    type=WholeRange(0, 2**31 - 1),
    help="With --study: of the draws by which the result is judged.  [default: the study's + 1]",
)
@jobs_option("Processes on this machine; a single one where a generation has at most 100 runs.")
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
    rule tables, symmetric in e and its rate; for any other controller, all of its own numbers. By CMA-ES; a
    fall costs as ten runs.
    """
    from trunk_studies.batch.workers import cores
    from trunk_studies.learning import Learned, learn
    from trunk_studies.study import read_study
    from trunk_studies.tuning.search import Optimum, search

    from ..console.tune_document import SearchResult

    _check(options)
    how: dict[str, Any] = {}
    optimum: Optimum | Learned
    with progress_bar("generations") as tell:
        settings = metric, generations, population, seed

        def heard(done: int, best: float) -> None:
            tell(done, generations, f"best {best:.5g}")

        if study is not None:
            own = "scenarios", "params", "settings", "rate"
            exclude("--study has its own scenario, parameters and rate", *own)
            spec = read_study(study)
            held_out = spec.seed + 1 if held_out_seed is None else held_out_seed
            optimum = learn(spec, controller, *settings, held_out, jobs or cores(), heard)
            plan, over = optimum.plan, f"{spec.runs} draws of {study}"
            how["study"] = _study_result(optimum, study, metric, held_out)
        else:
            loop = options["params"], options["settings"], options["rate"]
            plans = [loop_plan(controller, *loop, scenario) for scenario in scenarios]
            optimum = search(plans, *settings, jobs or cores(), heard)
            plan, over = plans[0], ", ".join(scenarios)
    if not options["as_json"]:
        click.echo(
            f"{metric}, mean over {over}, a fall as {optimum.fall_costs:.4g}: {optimum.before:.6g} before, "
            f"{optimum.after:.6g} after {optimum.runs} runs (seed {seed})"
        )
        if isinstance(optimum, Learned):
            _show_learned(optimum, metric, held_out)
    names = scenarios if study is None else [plan.scenario]
    how["search"] = SearchResult(metric, names, optimum.before, optimum.after, optimum.runs, seed)
    _finish(plan, optimum.values, options, how)


def _plan(controller: str, options: dict[str, Any]) -> RunPlan:
    _check(options)
    plan = loop_plan(controller, options["params"], options["settings"], options["rate"])
    useless = map(plan.simulator.kind.words, _without_effect(controller, options["settings"]))
    before = {*advice(plan)}  # of gains that are about to be replaced
    show_warnings((*(line for line in plan.warnings if line not in before), *useless))
    return plan


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


def _finish(
    plan: RunPlan,
    values: dict[str, Value],
    options: dict[str, Any],
    how: dict[str, Any] | None = None,
    unstable: str = "",
) -> None:
    """Print the gains and their margins and write the file; refuse what the node would refuse.

    ``how``: the method's own results in the JSON document, under the method's name.
    ``unstable``: a warning if the loop is not stable in any row.
    """
    from trunk_studies.tuning.stability_margins import plan_margins

    name = plan.controller_name
    config = changed(plan.controller, values)
    tuned = plan.with_controller(config)
    try:
        margins = plan_margins(tuned)
    except PlanError as error:  # a law of another kind: its gains are worth no less
        margins = []
        show_warnings([f"no margins: {error}"])
    if unstable and margins and all(row.margins is None for row in margins):
        show_warnings([unstable])
    if options["output"] is not None:
        write(options["output"], {name: values})
    if options["as_json"]:
        show_warnings(margin_warnings(tuned, margins))
        from ..console.tune_document import TuneResult

        rate = plan.controller.update_rate
        write_json(TuneResult(name, options["output"], values, rate, margins, **(how or {})))
        return
    before = values_of(plan.controller)
    axes = config.axes if isinstance(config, RuleBaseConfig) else None
    tables = {key: rows for key, rows in values.items() if axes is not None and is_table(rows)}
    print_table(
        name,
        ("parameter", "value"),
        [
            (
                key,
                differing_texts((before[key], value), axes)[1]
                if key in tables
                else value_text(value),
            )
            for key, value in values.items()
        ],
    )
    for key, rows in tables.items():
        if axes is not None and rows != before[key]:
            head, *cells = change_grid(before[key], rows, axes)  # type: ignore[arg-type]
            print_table(key, head, cells)
    if margins:
        print_margins(tuned, margins)
    if options["output"] is not None:
        click.echo(f"{options['output']}: for --params, or ros2 run … --ros-args --params-file")


def _show_relay(experiment: Relay, unit: str) -> None:
    """Print a relay experiment as a table, Ku in a unit."""
    print_table(
        "relay experiment",
        ("quantity", "relay", "Routh", "unit"),
        [
            ("Ku", f"{experiment.gain:.5g}", f"{experiment.exact_gain:.5g}", unit),
            ("Tu", f"{experiment.period:.5g}", f"{experiment.exact_period:.5g}", "s"),
            ("amplitude", f"{experiment.amplitude:.5g}", "", "rad"),
        ],
    )


def _differences(learned: Learned, metric: str) -> list[PairedDifference]:
    """Return the learned parameters' metric minus that of each other contender, held-out draws."""
    _, new, *_ = learned.held_out
    return [new.less(other, metric) for other in learned.held_out if other is not new]


def _show_learned(learned: Learned, metric: str, seed: int) -> None:
    """Print falls, means and paired differences."""
    from trunk_studies.statistics import estimate_text, number_text, percent

    rows = []
    for draws, outcomes in (("searched", learned.searched), (f"seed {seed}", learned.held_out)):
        for o in outcomes:
            share = f"{percent(o.share.value)} [{percent(o.share.low)}…{percent(o.share.high)}]"
            mean = number_text(o.mean) if isfinite(o.mean) else ""
            rows.append((o.controller, draws, f"{o.fell} of {o.runs}", share, mean))
    print_table(
        "falls with Wilson's intervals, and the mean over the runs that stood",
        ("controller", "draws", "fell", "share", metric),
        rows,
        texts=2,
    )
    print_table(
        f"{metric} on held-out draws, learned minus other, where both stood",
        ("other", "pairs", "mean difference", "smaller"),
        [
            (d.second, str(d.pairs), estimate_text(d.mean_with_bounds), d.verdict)
            for d in _differences(learned, metric)
        ],
    )


def _study_result(learned: Learned, source: str, metric: str, seed: int) -> StudySearchResult:
    """Return the same for the document."""
    from ..console.tune_document import LearnedDifference, StudySearchResult

    rows = [
        LearnedDifference(d.second, d.pairs, d.mean_with_bounds, d.verdict)
        for d in _differences(learned, metric)
    ]
    return StudySearchResult(
        source, learned.fall_costs, seed, learned.searched, learned.held_out, rows
    )
