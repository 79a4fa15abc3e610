"""``trunk controller``: a controller of your own, made and checked."""

from __future__ import annotations

import click

from ...console.verbs import LazyVerbs


@click.group(
    "controller",
    cls=LazyVerbs,
    package=__name__,
    modules={"check-node": "check_node"},
    overview={
        "new": "Make a package: a sliding-mode controller to change into your own.",
        "check": "Apply the conformance kit to a registered controller.",
        "check-node": "Play states at a running node, in any language, and judge its answers.",
    },
)
def command() -> None:
    """Make a controller of your own, and check it: a law in Python, or a node in any language."""
