"""``trunk watch``: a recording, played in a browser."""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path

import click

from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import RecordingError

from ..console.document import json_option
from ..console.page import PageResult, checked_host, page_options, serve, show_address
from ..gateway.process import GatewayProcess
from ..recorded.run import RecordedRun
from ..runs.node_processes import Interrupt


@click.command("watch")
@click.argument("run", type=click.Path(path_type=Path))
@page_options
@json_option(PageResult)
def command(run: Path, host: str, port: int, url: str, browser: bool, as_json: bool) -> None:
    """Play the recording RUN in a browser, in the page of trunk live: seek, speed, loop."""
    host = checked_host(host, url)
    # What cannot be read or shown is reported here.
    if not RecordedRun.open(run).count(topics.GROUND_TRUTH):
        raise RecordingError(f"{run}: it has no true states of the trunk: there is nothing to play")
    with Interrupt() as interrupt, tempfile.TemporaryDirectory(prefix="trunk_watch_") as folder:
        shown = {"recording": str(run.absolute())}
        log = Path(folder) / "gateway.log"
        with closing(GatewayProcess(log, host, port, shown, url)) as gateway:
            show_address(gateway, browser, run, controls=False, as_json=as_json)
            click.echo("playing until Ctrl-C")
            serve(gateway, interrupt)
