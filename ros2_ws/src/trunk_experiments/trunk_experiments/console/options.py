"""What verbs share of options: types, what a shell completes, the plan that options make, the output file.

An output follows one rule, checked before any work: never over an input, whatever the options; over an
existing file only with ``--force``; only with an allowed suffix; only into a folder that exists.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import isfinite
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any

import click
from click.core import ParameterSource

from trunk_core.errors import PlanError, did_you_mean
from trunk_core.files import will_write
from trunk_core.parameters.declarations import UnitError
from trunk_core.parameters.to_si import number_in
from trunk_core.results import Result
from trunk_evidence.recorded_run import name_of_run

from .document import json_asked
from .terminal import show_warnings

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from trunk_runs.plan import RunPlan

    Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]

Option = Callable[[Any], Any]  # decorates a verb's function

_STDOUT = (Path("/dev/stdout"), Path("/dev/fd/1"))
FORCE = "Replace the file if it exists."

# Limits of a push by hand, unless a file or --set gives others: the trunk's controllers can stand these.
HAND = {"operator.force": 100.0, "operator.torque": 40.0}


def exclude(reason: str, *names: str, but: Iterable[str] = ()) -> None:
    """Refuse parameters that were given and would be ignored: ``names``, or all ``but`` some.

    Raises PlanError with the reason.
    """
    context = click.get_current_context()
    for parameter in context.command.params:
        name = str(parameter.name)
        excluded = name in names if names else name not in but
        if excluded and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            word = parameter.opts[0] if isinstance(parameter, click.Option) else name.upper()
            raise PlanError(f"{reason}: leave out {word}")


class Number(click.ParamType[float]):
    """A number in a unit, or with another unit of the same dimension, as in ``100ms``."""

    name = "float"

    def __init__(self, unit: str) -> None:
        self.unit = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number in the unit. Raises click.BadParameter if it cannot be read."""
        try:
            return number_in(value, self.unit)
        except UnitError as error:
            self.fail(f"{value!r}: {error}", param, ctx)


class FiniteRange(click.FloatRange):
    """A range of floats in a unit that excludes NaN and, whatever its bounds, infinity.

    ``unit``: also a function that returns it from the values of eager options.
    """

    def __init__(
        self, *args: Any, unit: str | Callable[[Mapping[str, Any]], str] = "", **kwargs: Any
    ) -> None:
        super().__init__(*args, **kwargs)
        self.unit = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number. Raises click.BadParameter if it is not one or not in the range."""
        given = {} if ctx is None else ctx.params
        unit = self.unit if isinstance(self.unit, str) else self.unit(given)
        number: float = super().convert(Number(unit).convert(value, param, ctx), param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class WholeRange(click.IntRange):
    """A range of integers, in ASCII digits without underscores."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the integer. Raises click.BadParameter if it is not one or not in the range."""
        if isinstance(value, str) and ("_" in value or not value.isascii()):
            self.fail(f"{value!r} is not a valid {self.name}.", param, ctx)
        number: int = super().convert(value, param, ctx)
        return number


class Name(click.Choice[str]):
    """One of some names; for any other, the error suggests the closest, or else gives the ``hint``."""

    hint = ""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name. Raises click.BadParameter if there is no such name."""
        if value not in self.choices:
            known = ", ".join(map(str, self.choices))
            meant = did_you_mean(str(value), map(str, self.choices))
            self.fail(f"{value!r}: give one of {known}{meant or self.hint}", param, ctx)
        return str(value)


class ControllerName(Name):
    """The name of a controller that can be used here; for any other, the error says why it cannot."""

    hint = "; build and source your own package first"

    def __init__(self) -> None:
        from trunk_runs.nodes import CONTROLLERS

        super().__init__(CONTROLLERS)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name. Raises click.BadParameter."""
        from trunk_runs.nodes import UNUSABLE

        if value in UNUSABLE:
            self.fail(UNUSABLE[value], param, ctx)
        return super().convert(value, param, ctx)


def together(*options: Option) -> Option:
    """Return one decorator that adds some options, in the order in which help lists them."""
    return lambda function: reduce(lambda inner, add: add(inner), reversed(options), function)


def jobs_option(text: str) -> Option:
    """Return the option ``--jobs``, None for as many as `workers.cores`."""
    text += "  [default: one per core that may be used]"
    return click.option("--jobs", type=WholeRange(1, 1024), help=text)


def names_or_files(known: str) -> Complete:
    """Return a completion of names, or of files if no name begins with what was typed.

    ``known``: ``module:name`` of the names, or of a function that returns them; imported when a shell asks.
    """

    def complete(
        _context: click.Context, _parameter: click.Parameter, begun: str
    ) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        names = resolve_name(known)
        names = names() if callable(names) else names
        items = [CompletionItem(name) for name in names if name.startswith(begun)]
        return items or [CompletionItem(begun, type="file")]

    return complete


scenarios = names_or_files("trunk_runs.scenario:SCENARIOS")
parameter_files = names_or_files("trunk_runs.scenario:shipped_files")
studies = names_or_files("trunk_studies.study:shipped_studies")
nodes = names_or_files("trunk_runs.nodes:NODES")

device_option = click.option(
    "--device",
    type=click.Choice(("cpu", "cuda")),
    default="cpu",
    show_default=True,
    help="Where runs are made: cuda, a GPU, gives the same bits; docs/sweep.md.",
)
results_argument = click.argument(
    "results",
    metavar="OUT.parquet",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
)
markers_option = click.option(
    "--markers",
    is_flag=True,
    help="Also record a picture for Foxglove's and RViz's 3-D views: markers, tf, robot_description.",
)
push_option = click.option(
    "--push",
    "pushes",
    multiple=True,
    metavar="[CHANNEL=]VALUE:DURATION[@TIME]",
    help="A pulse besides the scenario's disturbances, such as 60Nm:0.1s@3 or hip_effort=300N:50ms@2.5s; "
    "repeatable.",
)
external_option = click.option(
    "--external",
    is_flag=False,
    flag_value="",
    metavar="[NAME]",
    help="Your own node gives the commands, instead of a controller of ours; the run goes by NAME, "
    "or by the node's name.",
)
parameter_options = together(
    click.option(
        "--params",
        multiple=True,
        metavar="FILE",
        is_eager=True,  # the plant that it names chooses units of other options
        help="A parameter file, by path or shipped name; repeatable, later ones win.",
        shell_complete=parameter_files,
    ),
    click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="NODE.PARAM=VALUE",
        is_eager=True,
        help="One value, overrides all files; in SI units, or with a unit, such as 45deg; repeatable.",
    ),
)
# From these `loop_plan` makes the plan of a sampled loop.
loop_options = together(
    parameter_options,
    click.option(
        "--rate",
        type=FiniteRange(0.001, 1e6, unit="Hz"),
        metavar="HZ",
        help="update_rate of the sampled loop, Hz.",
    ),
)


def loop_plan(
    controller: str,
    params: tuple[str, ...],
    settings: tuple[str, ...],
    rate: float | None,
    scenario: str = "fig6",
) -> RunPlan:
    """Return the plan of a loop whose profile is profile_practical unless ``params`` give another."""
    from trunk_runs.plan import make_plan

    everywhere = {} if rate is None else {"update_rate": rate}
    return make_plan(scenario, controller, ("profile_practical", *params), settings, everywhere)


def plan_options(
    required: bool = True,
    several: tuple[str, ...] = (),
    of_several: str = "The first one acts, the others stand by; repeatable.",
) -> Option:
    """Return a decorator that adds the argument and options from which `plan_of` makes a plan.

    ``several``: the default of a verb that takes several controllers, and what it says ``of_several``.
    """
    return together(
        click.argument("scenario", required=required, shell_complete=scenarios),
        click.option(
            "--controller",
            default=list(several) or "fuzzy_pid",
            show_default=True,
            type=ControllerName(),
            multiple=bool(several),
            help=of_several if several else "The controller node.",
        ),
        parameter_options,
        click.option(
            "--swap-at",
            "swaps",
            multiple=True,
            metavar="T:CONTROLLER",
            help="Another controller takes over at T s, starting from the torque applied then; repeatable.",
        ),
        click.option(
            "--duration",
            type=Number("s"),
            metavar="S",
            help="Simulated time in s, or with another unit, such as 2min.",
        ),
        click.option(
            "--rate",
            type=Number("Hz"),
            metavar="HZ",
            help="update_rate of simulator and controller in Hz, or with another unit, such as 1kHz.",
        ),
    )


def plan_of(
    scenario: str,
    controller: str,
    params: Sequence[str],
    settings: Sequence[str],
    duration: float | None,
    rate: float | None,
    extra: Mapping[str, object] | None = None,
    namespace: str = "",
    swaps: Sequence[str] = (),
    standby: Sequence[str] = (),
    below: Mapping[str, object] | None = None,
    external: str | None = None,
    pushes: Sequence[str] = (),
) -> RunPlan:
    """Return the plan for the options of `plan_options`, with ``extra`` for all nodes.

    ``below``: values for all nodes that declare them, where nothing else sets them.
    """
    from trunk_runs.plan import make_plan, parse_swap
    from trunk_runs.scenario import checked_external

    if external is not None:
        exclude("--external: your own node gives the commands", "controller", "swaps")
        external = checked_external(external)
    everywhere: dict[str, object] = dict(extra or {})
    if duration is not None:
        everywhere["duration"] = duration
    if rate is not None:
        everywhere["update_rate"] = rate
    plan = make_plan(
        scenario,
        controller,
        params,
        settings,
        everywhere,
        namespace,
        [parse_swap(text) for text in swaps],
        standby=standby,
        below=below,
        external=external,
        pushes=pushes,
        source="--",
    )
    show_warnings(plan.warnings)
    return plan


@dataclass(frozen=True)
class PlanResult(Result):
    """What every document says about a plan."""

    scenario: str
    controllers: Annotated[tuple[str, ...], "All of the plan"]
    duration_s: Annotated[float, "0: without an end"]
    update_rate_hz: Annotated[float, "The simulator's"]


def about_plan(plan: RunPlan) -> PlanResult:
    """Return the facts about a plan that documents have."""
    simulator = plan.simulator
    names = tuple(plan.controllers)
    return PlanResult(plan.scenario, names, simulator.duration, simulator.update_rate)


def files_read(options: dict[str, Any]) -> list[str]:
    """Return the files that the options of `plan_options` name: scenario, parameters, by path or name."""
    return [name for name in (options.get("scenario"), *options.get("params", ())) if name]


@dataclass(frozen=True)
class OutputResult(Result):
    """What documents of verbs that write one file begin with."""

    output: Annotated[Path, "The file that is written"]


def output_options(text: str, required: bool = False, force: str = FORCE) -> Option:
    """Return a decorator that adds ``-o, --output FILE``, described by ``text``, and ``--force``."""
    output = click.Path(path_type=Path)
    return together(
        click.option("-o", "--output", type=output, required=required, help=text),
        click.option("--force", is_flag=True, help=force),
    )


def check_output(
    path: Path,
    suffixes: Sequence[str] = (),
    force: bool = False,
    inputs: Iterable[str | Path] = (),
    option: str = "--output",
    chooses_format: bool = False,
) -> Path:
    """Return an output; refuse, before any work, one that must not or cannot be written.

    ``suffixes``: what its name may end in; empty: anything. ``force``: a file that exists is replaced.
    ``inputs``: what the verb reads; names that are not files are ignored. /dev/stdout and the like are
    written to, except where the suffix ``chooses_format``. Raises PlanError.
    """
    place = f"{option} {path}"
    if is_stream(path) and not chooses_format:
        if json_asked() and path in _STDOUT:
            raise PlanError(f"{place}: with --json the document goes there: name a file")
        return path
    if path.is_dir():
        raise PlanError(f"{place}: it is a folder: name a file")
    if suffixes and path.suffix.lower() not in suffixes:
        allowed = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise PlanError(f"{place}: the file's name must end in {allowed}")
    folder = path.parent
    if not folder.exists():
        raise PlanError(f"{place}: there is no folder {folder}: make it, or give another")
    if not folder.is_dir():
        raise PlanError(f"{place}: {folder} is not a folder: give another")
    if not os.access(folder, os.W_OK):
        raise PlanError(f"{place}: {folder} cannot be written to: give another")
    if path.exists():
        check_not_read(path, inputs, option)
        if not force:
            raise PlanError(f"{place}: it exists: give another name, or --force")
    will_write(path, overwrite=force)
    return path


def is_stream(path: Path) -> bool:
    """Return True for what is not a regular file, such as /dev/stdout."""
    return path.is_relative_to("/dev") and not path.is_relative_to("/dev/shm")


def check_not_read(path: Path, inputs: Iterable[str | Path], option: str = "--output") -> None:
    """Refuse to overwrite what the verb reads, whatever the options. Raises PlanError."""
    for source in inputs:
        if _is_same(path, Path(source)):
            raise PlanError(
                f"{option} {path}: it is read by this command ({source}): give another name"
            )


def check_folder(path: Path, force: bool = False) -> Path:
    """Return a folder for results; refuse one that is not empty, unless ``force``.

    Raises PlanError.
    """
    if path.exists() and not path.is_dir():
        raise PlanError(f"--output {path}: it is not a folder: give another")
    if path.is_dir() and not force and any(path.iterdir()):
        raise PlanError(f"--output {path}: the folder is not empty: give another, or --force")
    return path


def default_name(run: Path, suffix: str) -> Path:
    """Return a verb's default output: in the current folder, named after a run's folder or file.

    ``fig8/run.mcap`` and ``fig8`` give ``fig8.png``; ``mine.mcap`` gives ``mine.png``.
    """
    return Path(f"{name_of_run(run) or 'run'}{suffix}")


def _is_same(path: Path, other: Path) -> bool:
    """Return True if ``other`` is the file, or a folder with a recording that is."""
    try:
        recordings = other.glob("*.mcap") if other.is_dir() else [other]
        return any(path.samefile(recording) for recording in recordings)
    except OSError:  # a name that is not a file: a scenario's, a shipped file's
        return False
