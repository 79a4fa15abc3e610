"""``trunk study``: what a study's results tell: a report, one of its runs, which parameter matters."""

from __future__ import annotations

import click

from ...console.verbs import Verbs
from .report import report
from .sensitivity import sensitivity
from .show import show


@click.group("study", cls=Verbs)
def command() -> None:
    """Read a study: a report, one of its runs, which parameter matters."""


for _command in (report, show, sensitivity):
    command.add_command(_command)
