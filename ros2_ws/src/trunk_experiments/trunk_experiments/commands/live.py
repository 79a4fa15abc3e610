"""``trunk live``: a run in the ROS 2 graph, in a browser."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack, closing
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from trunk_msgs_util.node import middleware
from trunk_msgs_util.node.early_signals import Interrupt

from ..console.document import json_option
from ..console.options import exclude
from ..console.outputs import check_not_read, output_options
from ..console.page import PageResult, checked_host, page_options, serve, show_address
from ..console.plan_options import HAND, external_option, files_read, plan_of, plan_options
from ..console.terminal import line_of, report_error
from ..errors import GatewayError, PlanError, RunError
from ..gateway.process import GatewayProcess
from ..plans.files import checked_namespace
from ..recorded.run import RecordedRun
from ..runs.graph import run_graph
from ..runs.launching import connection_lines
from ..runs.node_processes import check_nodes_installed, claimed_domain
from ..runs.run_files import GATEWAY_LOG, RunFiles
from .run import show_run

_REPORT = "report.html"
_OF_THE_PAGE = ("attach", "host", "port", "url", "browser", "as_json")


@click.command("live")
@partial(plan_options, required=False, several=("fuzzy_pid",))
@external_option
@output_options(
    "Folder for the recording, parameters and logs.  [default: runs/TIME_SCENARIO_CONTROLLER]",
    force="Replace the files of a run that is in the folder.",
)
@click.option(
    "--realtime",
    is_flag=True,
    help="Paced by the clock, whether answers came in time or not.  [default with --external]",
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="The plant waits for every answer, at a speed that the page can change.  [default]",
)
@click.option(
    "--attach",
    metavar="NAMESPACE",
    help="Join the graph that is running in this namespace; / for none.",
)
@page_options
@click.option(
    "--browser/--no-browser", default=True, help="Open the page in a browser, where there is one."
)
@json_option(PageResult)
def command(
    scenario: str | None,
    controller: tuple[str, ...],
    output: Path | None,
    force: bool,
    realtime: bool,
    lockstep: bool,
    attach: str | None,
    host: str,
    port: int,
    url: str,
    browser: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Run SCENARIO in the ROS 2 graph with a page in a browser: push the trunk, tune, swap controllers.

    SCENARIO is fig6, fig7, fig8, fig9, demo, or the path of a parameter file.  [default: demo]

    The run goes on until it is stopped, in the page or by Ctrl-C, and is recorded.
    """
    host = checked_host(host, url)
    paced_by_clock = _paced_by_clock(realtime, lockstep, options["external"] is not None)
    middleware.prepare()
    if attach is not None:
        exclude("--attach joins a graph as it is", but=_OF_THE_PAGE)
        _attach(checked_namespace(attach), host, port, url, browser, as_json)
        return
    check_nodes_installed()
    claim = click.get_current_context().with_resource(ExitStack())
    claim.enter_context(claimed_domain())
    everywhere: dict[str, object] = {"duration": 0.0}
    if not paced_by_clock:
        everywhere |= {"lockstep.enabled": True, "lockstep.speed": 1.0}
    first, *others = controller
    plan = plan_of(
        scenario=scenario or "demo",
        controller=first,
        **options,
        extra=everywhere,
        standby=others,
        below=HAND,
    )
    if output is not None:
        for file in (*RunFiles(output).all, output / _REPORT):
            check_not_read(file, files_read({"scenario": scenario, **options}))
    files = RunFiles.for_run(plan, output, force)
    click.get_current_context().call_on_close(files.settle)
    files.logs.mkdir(parents=True, exist_ok=True)
    shown = {
        "namespace": "",
        "standby": [n for n in others if n != first],
        "stoppable": not plan.simulator.duration,
    }
    gateway = GatewayProcess(files.logs / GATEWAY_LOG, host, port, shown, url)
    with closing(gateway):
        show_address(gateway, browser, files.recording, as_json=as_json)
        for line in connection_lines(plan) if plan.external is not None else ():
            click.echo(line)
        click.echo(f"{plan.scenario}, {plan.turns}: runs until it is stopped, here with Ctrl-C")
        heard: list[str] = []
        shown_page = True

        def over() -> bool:
            nonlocal shown_page
            try:
                heard.extend(gateway.words() if shown_page else ())
            except (GatewayError, OSError) as error:  # the run does not depend on it
                shown_page = False
                report_error(error)
            return "stop" in heard

        try:
            with claim:  # not longer: who looks at the report does not keep the next run waiting
                recording = run_graph(plan, files, lambda t: None, over=over, note=click.echo)
        except RunError as error:
            gateway.tell(over=line_of(error))
            raise
        click.echo("reading the recording")
        run = RecordedRun(recording)
        run.read_whole()  # once for metrics, doubts and report
        show_run(files, run, interrupted=not plan.simulator.duration)
        if "stop" in heard:
            _show_report(gateway, run, files.folder / _REPORT)
        if not recording.complete:
            click.get_current_context().exit(1)


def _paced_by_clock(realtime: bool, lockstep: bool, external: bool) -> bool:
    """Return True for a run paced by the clock. Raises PlanError if both modes are asked for.

    The default is lock-step, which is exact on a busy machine too. An external node need not answer every
    state, nor stamp its commands, and lock-step would wait for it in vain.
    """
    if realtime and lockstep:
        raise PlanError("--realtime does not go with --lockstep: give one of them")
    return realtime or (external and not lockstep)


def _attach(namespace: str, host: str, port: int, url: str, browser: bool, as_json: bool) -> None:
    if find_spec("rclpy") is None:
        raise ModuleNotFoundError(name="rclpy")  # reported by the command, before a page is opened
    with tempfile.TemporaryDirectory(prefix="trunk_live_") as folder:
        log = Path(folder) / GATEWAY_LOG
        gateway = GatewayProcess(log, host, port, {"namespace": namespace}, url)
        with Interrupt() as interrupt, closing(gateway):
            show_address(gateway, browser, None, as_json=as_json)
            click.echo(f"the graph in {namespace or '/'}: until Ctrl-C, which ends only the page")
            serve(gateway, interrupt)


def _show_report(gateway: GatewayProcess, run: RecordedRun, path: Path) -> None:
    """Write the run's report, and serve it until every page has opened it or was closed, or Ctrl-C."""
    click.echo("making the report")
    from ..views.report import make_report, write
    from ..views.run_view import RunView

    write(make_report([RunView.read(run)]), path)
    click.echo(f"report: {path}")
    gateway.tell(report=str(path.absolute()), over="")

    def left(word: str) -> bool:
        if word == "waiting":
            click.echo("waiting for the page to fetch the report; Ctrl-C ends")
        return word == "left"

    with Interrupt() as interrupt:
        serve(gateway, interrupt, left)
