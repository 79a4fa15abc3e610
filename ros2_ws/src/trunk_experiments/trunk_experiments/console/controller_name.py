"""A controller's name on the command line."""

from __future__ import annotations

from typing import Any

import click

from ..plans.nodes import CONTROLLERS, UNUSABLE
from .common import Name


class ControllerName(Name):
    """The name of a controller that can be used here; for any other, the error says why it cannot."""

    hint = "; build and source your own package first"

    def __init__(self) -> None:
        super().__init__(CONTROLLERS)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name. Raises click.BadParameter."""
        if value in UNUSABLE:
            self.fail(UNUSABLE[value], param, ctx)
        return super().convert(value, param, ctx)
