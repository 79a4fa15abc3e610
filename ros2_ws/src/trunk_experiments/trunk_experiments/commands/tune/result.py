"""What ``trunk tune`` prints of its result, and the parameter file that it writes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from trunk_control.pid_family import Gains
from trunk_control.rule_base import RuleBaseConfig
from trunk_control.rule_tables import is_table
from trunk_msgs_util.parameters.declarations import Value, changed, values_of
from trunk_msgs_util.parameters.files import write

from ...analysis.parameter_text import change_grid, differing_texts, value_text
from ...console.document import write_json
from ...console.tables import print_table
from ...console.terminal import show_warnings
from ...errors import PlanError
from ...plans.plan import RunPlan
from ..margins import margin_warnings, print_margins

if TYPE_CHECKING:
    from ...tuning.methods import Relay


def finish(
    plan: RunPlan,
    gains: Gains,
    options: dict[str, Any],
    others: dict[str, Value] | None = None,
    how: dict[str, Any] | None = None,
) -> None:
    """Do as `finish_values` with the gains of a PID, and ``others``."""
    values: dict[str, Value] = {f"gains.{n}": getattr(gains, n) for n in "pid"}
    finish_values(plan, {**values, **(others or {})}, options, how)


def finish_values(
    plan: RunPlan,
    values: dict[str, Value],
    options: dict[str, Any],
    how: dict[str, Any] | None = None,
) -> None:
    """Print the gains and their margins and write the file; refuse what the node would refuse.

    ``how``: the method's own results in the JSON document, under the method's name.
    """
    from ...tuning.margins import plan_margins

    name = plan.controller_name
    config = changed(plan.controller, values)
    tuned = plan.with_controller(config)
    try:
        margins = plan_margins(tuned)
    except PlanError as error:  # a law of another kind: its gains are worth no less
        margins = []
        show_warnings([f"no margins: {error}"])
    if options["output"] is not None:
        write(options["output"], {name: values})
    if options["as_json"]:
        show_warnings(margin_warnings(tuned, margins))
        from .document import TuneResult

        rate = plan.controller.update_rate
        write_json(TuneResult(name, options["output"], values, rate, margins, **(how or {})))
        return
    before = values_of(plan.controller)
    axes = config.axes if isinstance(config, RuleBaseConfig) else None
    tables = {key: rows for key, rows in values.items() if axes is not None and is_table(rows)}
    print_table(
        name,
        ("parameter", "value"),
        [
            (
                key,
                differing_texts((before[key], value), axes)[1]
                if key in tables
                else value_text(value),
            )
            for key, value in values.items()
        ],
    )
    for key, rows in tables.items():
        if axes is not None and rows != before[key]:
            head, *cells = change_grid(before[key], rows, axes)  # type: ignore[arg-type]
            print_table(key, head, cells)
    if margins:
        print_margins(tuned, margins)
    if options["output"] is not None:
        click.echo(f"{options['output']}: for --params, or ros2 run … --ros-args --params-file")


def show_relay(experiment: Relay) -> None:
    """Print a relay experiment as a table."""
    print_table(
        "relay experiment",
        ("quantity", "relay", "Routh", "unit"),
        [
            ("Ku", f"{experiment.gain:.5g}", f"{experiment.exact_gain:.5g}", "N m/rad"),
            ("Tu", f"{experiment.period:.5g}", f"{experiment.exact_period:.5g}", "s"),
            ("amplitude", f"{experiment.amplitude:.5g}", "", "rad"),
        ],
    )
