"""``trunk live``: a run in the ROS 2 graph, in a browser."""

from __future__ import annotations

import ipaddress
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import click

from trunk_core.errors import GatewayError, PlanError, RunError
from trunk_core.results import Result
from trunk_evidence.recorded_run import RecordedRun
from trunk_msgs_util.node import middleware
from trunk_msgs_util.node.early_signals import Interrupt
from trunk_runs.graph import run_graph
from trunk_runs.processes import check_nodes_installed, claimed_domain, connection_lines
from trunk_runs.run_files import GATEWAY_LOG, RunFiles
from trunk_runs.scenario import checked_namespace
from trunk_views.live.access import origin_of
from trunk_views.live.process import LOOPBACK, GatewayProcess

from ..console.document import json_option, write_json
from ..console.options import (
    HAND,
    WholeRange,
    check_not_read,
    exclude,
    external_option,
    files_read,
    output_options,
    plan_of,
    plan_options,
    together,
)
from ..console.terminal import line_of, open_page, report_error
from .run import show_run

_REPORT = "report.html"
_OF_THE_PAGE = ("attach", "host", "port", "url", "browser", "as_json")
_LOOK_S = 0.05


_page_options = together(
    click.option(
        "--host",
        default=LOOPBACK,
        show_default=True,
        metavar="ADDRESS",
        help="Address of this machine for the page; any but the default is open to other machines.",
    ),
    click.option(
        "--port",
        type=WholeRange(0, 65535),
        default=0,
        help="Port of the page.  [default: a free one]",
    ),
    click.option(
        "--url",
        default="",
        metavar="URL",
        callback=lambda context, option, url: _checked_url(url),
        help="What browsers open, such as http://127.0.0.1:8080, where a container's port, a tunnel or "
        "a proxy leads to the page; any other address is refused.  [default: host and port]",
    ),
)


@dataclass(frozen=True)
class PageResult(Result, document="page-1"):
    """The document of ``trunk live``."""

    address: Annotated[str, "Of the page, to control the run"]
    watch_address: Annotated[str, "Of the page, to watch only"]
    recording: Annotated[Path | None, "Written; null for a graph that was joined"]


@click.command("live")
@plan_options(required=False, several=("fuzzy_pid",))
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
@_page_options
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

    SCENARIO is fig6, fig7, fig8, fig9, demo, cart_pole, or the path of a parameter file.  [default: demo]

    The run goes on until it is stopped, in the page or by Ctrl-C, and is recorded.
    """
    host = _checked_host(host, url)
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
        _show_address(gateway, browser, files.recording, as_json=as_json)
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
            _show_address(gateway, browser, None, as_json=as_json)
            click.echo(f"the graph in {namespace or '/'}: until Ctrl-C, which ends only the page")
            _serve(gateway, interrupt)


def _show_report(gateway: GatewayProcess, run: RecordedRun, path: Path) -> None:
    """Write the run's report, and serve it until every page has opened it or was closed, or Ctrl-C."""
    click.echo("making the report")
    from trunk_views.run_report import make_report, write
    from trunk_views.run_view import RunView

    write(make_report([RunView.read(run)]), path)
    click.echo(f"report: {path}")
    gateway.tell(report=str(path.absolute()), over="")

    def left(word: str) -> bool:
        if word == "waiting":
            click.echo("waiting for the page to fetch the report; Ctrl-C ends")
        return word == "left"

    with Interrupt() as interrupt:
        _serve(gateway, interrupt, left)


def _checked_host(host: str, url: str) -> str:
    """Return the address to serve on.

    Raises PlanError for a name, and for all addresses at once where no ``url`` says what browsers open.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        address = None
    if address is None or (address.is_unspecified and not url):
        raise PlanError(
            f"--host {host}: give one address of this machine, at which browsers will reach it, such as "
            f"{LOOPBACK}; all of them, 0.0.0.0, need --url, the address that browsers open"
        )
    return str(address)


def _checked_url(url: str) -> str:
    try:
        return origin_of(url) if url else ""
    except ValueError as error:
        raise PlanError(f"--url {url}: {error}") from None


def _show_address(
    gateway: GatewayProcess, browser: bool, recording: Path | None, as_json: bool = False
) -> None:
    """Print the page's addresses, and open the first one in a browser, where there is one."""
    watch = gateway.address(gateway.tokens.watch)
    address = gateway.address(gateway.tokens.control)
    if as_json:
        write_json(PageResult(address, watch, recording))
    click.echo(f"page: {address}")
    click.echo(f"to watch only: {watch}")
    if browser:
        open_page(address)


def _serve(
    gateway: GatewayProcess,
    interrupt: Interrupt,
    over: Callable[[str], bool] = lambda word: False,
) -> None:
    """Keep the gateway up until it is interrupted, or until a word from it is ``over``."""
    while not interrupt.name:
        if any(over(word) for word in gateway.words()):
            return
        time.sleep(_LOOK_S)
