"""``trunk branch``: a recorded run as it was up to a time, and from then on with a change."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from trunk_core.errors import PlanError
from trunk_core.results import Result
from trunk_evidence.branching import Branch, branch_plan, fanned, record_branch
from trunk_sim.simulation import DivergedError

from ..console.document import json_option, write_json
from ..console.options import ControllerName, Number, check_folder, check_output, output_options
from ..console.reading import WrittenResult, about_written, open_run
from ..console.terminal import line_of, progress_bar, report_error, show_warnings

if TYPE_CHECKING:
    from trunk_evidence.recorded_run import RecordedRun
    from trunk_runs.plan import RunPlan

_LONG = 100_000  # states, which take seconds
_MANY = 1000  # branches, as long
_NAME = 120  # characters of a file's name


@dataclass(frozen=True)
class BranchedRun(WrittenResult):
    """A branch that was written."""

    at_s: Annotated[float, "Where it branches"]
    changes: Annotated[str, "What differs from there on"]
    failure: Annotated[str | None, "Why the branch ended before its end; null if it did not"]


@dataclass(frozen=True)
class BranchResult(Result, document="branch-1"):
    """The document of ``trunk branch RUN``."""

    parent: Annotated[Path, "The recording that was branched"]
    branches: list[BranchedRun]


class _InOrder(click.Command):
    """Keeps the order in which the options were given: each ``--at`` begins a branch."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does, and once more for the order."""
        _, _, order = self.make_parser(ctx).parse_args(list(args))
        ctx.meta[__name__] = [parameter.name for parameter in order]
        return super().parse_args(ctx, args)


@click.command("branch", cls=_InOrder)
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--at",
    "times",
    multiple=True,
    required=True,
    type=Number("s"),
    metavar="T",
    help="When to branch, s; repeatable: the options after it belong to this branch.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NODE.PARAM=VALUE",
    help="A parameter's new value from then on; repeatable.",
)
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    type=ControllerName(),
    help="The controller from then on; it continues from the torque that acts.",
)
@click.option(
    "--push",
    "pushes",
    multiple=True,
    metavar="[CHANNEL=]VALUE:DURATION[@TIME]",
    help="A pulse, such as 60Nm:0.1s or hip_effort=300N:50ms@2.5s; repeatable.",
)
@click.option(
    "--grid",
    multiple=True,
    metavar="NODE.PARAM=A,B,C",
    help="A branch for each value; repeatable: for each combination of values.",
)
@click.option(
    "--duration",
    type=Number("s"),
    metavar="S",
    help="When the branches end, s.  [default: as planned]",
)
@output_options(
    "An MCAP file to write, or a folder, in which each branch is named after what it changes.",
    required=True,
)
@json_option(BranchResult)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    run: Path,
    grid: tuple[str, ...],
    duration: float | None,
    output: Path,
    force: bool,
    as_json: bool,
    **_given: Any,
) -> None:
    """Branch a recorded run: as recorded up to T s, then simulated with a change.

    Disturbances, references, noise and later events stay as recorded. The branch names its parent, and
    verifies.
    """
    branches = fanned(list(_branches(ctx)), grid)
    paths = _paths(branches, run, output, force)
    parent = open_run(run, whole=True)
    plans = []
    with progress_bar("checking branches", _MANY) as tell:
        for branch in branches:
            plans.append(branch_plan(parent, branch, duration))
            tell(len(plans), len(branches))
    if output not in paths:
        output.mkdir(parents=True, exist_ok=True)
    written: list[BranchedRun] = []
    failed = 0
    for branch, path, plan in zip(branches, paths, plans, strict=True):
        show_warnings(plan.warnings)
        states, diverged = _recorded(parent, branch, plan, path, force)
        if as_json:
            failure = None if diverged is None else line_of(diverged)
            about = vars(about_written(path))
            written.append(
                BranchedRun(**about, at_s=branch.at, changes=branch.describe(), failure=failure)
            )
        elif diverged is None:
            click.echo(f"{path}: {states} states, from t = {branch.at:g} s {branch.describe()}")
        if diverged is not None:
            failed = report_error(diverged)
    if as_json:
        write_json(BranchResult(run, written))
    ctx.exit(failed)


def _branches(ctx: click.Context) -> Iterator[Branch]:
    """Yield the branches that the options ask for. Raises PlanError for an option before ``--at``."""
    names = {"settings": "--set", "controllers": "--controller", "pushes": "--push"}
    values = {name: iter(ctx.params[name]) for name in ("times", *names)}
    branch: Branch | None = None
    for name in ctx.meta[__name__]:
        if name not in values:
            continue
        value = next(values[name])
        if name == "times":
            if branch is not None:
                yield branch
            branch = Branch(value)
        elif branch is None:
            raise PlanError(
                f"{names[name]} {value}: give --at T first; the options after it belong to it"
            )
        elif name == "controllers":
            if branch.controller:
                raise PlanError(f"--controller {value}: give only one for each --at")
            branch = branch._replace(controller=value)
        elif name == "settings":
            branch = branch._replace(settings=(*branch.settings, value))
        else:
            branch = branch._replace(pushes=(*branch.pushes, value))
    if branch is not None:
        yield branch


def _paths(branches: list[Branch], run: Path, output: Path, force: bool) -> list[Path]:
    """Return the file of each branch, checked before any work. Raises PlanError."""
    if len(branches) == 1 and output.suffix.lower() == ".mcap":
        return [check_output(output, (".mcap",), force, [run])]
    if len(branches) > 1 and output.suffix.lower() == ".mcap":
        raise PlanError(f"--output {output}: {len(branches)} branches: name a folder")
    check_folder(output, force)
    known: set[Branch] = set()
    names: dict[str, None] = {}
    for i, branch in enumerate(branches):
        if branch in known:
            raise PlanError(f"two branches are the same: at {branch.at:g} s, {branch.describe()}")
        known.add(branch)
        name = _name(branch)
        names[f"{name}_{i + 1}" if name in names else name] = None
    for name in names if output.is_dir() else ():
        check_output(output / f"{name}.mcap", (".mcap",), force, [run])
    return [output / f"{name}.mcap" for name in names]


def _name(branch: Branch) -> str:
    """Return a file's name that says what a branch changes."""
    text = f"at_{branch.at:g}_{branch.describe()}"
    kept = "".join(c if c.isalnum() or c in "._=+-" else "_" for c in text)
    return kept[:_NAME]


def _recorded(
    parent: RecordedRun, branch: Branch, plan: RunPlan, path: Path, force: bool
) -> tuple[int, DivergedError | None]:
    """Write a branch, showing progress; return the number of states, or why it diverged."""
    with progress_bar(f"simulating {path.name}", _LONG) as tell_done:
        try:
            return record_branch(parent, branch, plan, path, force, tell_done), None
        except DivergedError as error:
            return 0, error
