"""What a shell completes besides files: scenarios, parameter files, studies, nodes.

Nothing is imported before a shell asks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def names_or_files(known: Callable[[], Iterable[str]]) -> Complete:
    """Return a completion of names, or of files if no name begins with what was typed."""

    def complete(
        _context: click.Context, _parameter: click.Parameter, begun: str
    ) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        found = [CompletionItem(name) for name in known() if name.startswith(begun)]
        return found or [CompletionItem(begun, type="file")]

    return complete


def scenarios() -> Iterable[str]:
    """Return the shipped scenarios."""
    from ..plans.files import SCENARIOS

    return SCENARIOS


def parameter_files() -> Iterable[str]:
    """Return the shipped parameter files."""
    from ..plans.files import shipped_files

    return shipped_files()


def studies() -> Iterable[str]:
    """Return the shipped studies."""
    from ..study.file import shipped_studies

    return shipped_studies()


def nodes() -> Iterable[str]:
    """Return the nodes' names, without a namespace."""
    from ..plans.nodes import NODES

    return NODES
