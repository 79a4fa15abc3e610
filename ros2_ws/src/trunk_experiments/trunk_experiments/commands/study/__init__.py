"""``trunk study``: what a study's results tell."""

from __future__ import annotations

import click

from ...console.verbs import LazyVerbs


@click.group(
    "study",
    cls=LazyVerbs,
    package=__name__,
    gone={"sensitivity": "trunk sweep STUDY --sobol N"},
    overview={
        "map": "Draw a sweep's results over two of its grid's variables.",
        "compare": "Compare a sweep's controllers over the same draws.",
        "report": "Write one HTML file on a sweep: falls, map, differences, the worst runs.",
        "show": "Run one of a sweep's runs again, as a recording that verifies.",
    },
)
def command() -> None:
    """Read a study: a map, controllers compared, a report, one of its runs."""
