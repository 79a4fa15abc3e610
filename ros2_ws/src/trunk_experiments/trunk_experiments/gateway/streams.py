"""Messages of a run as rows: which columns a stream has. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from trunk_control.fuzzy import fired_at
from trunk_control.rule_base import RuleBaseConfig
from trunk_msgs_util.units import seconds

from .feed import PLANT, PUSHES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trunk_msgs_util.samples import JointSample

PLANT_COLUMNS = ("t", "x", "theta", "x_dot", "theta_dot", "torque")  # s, m, rad, m/s, rad/s, N m
PUSH_COLUMNS = ("t", "force", "torque")  # s, N, N m
# Where the four rules that fire begin, and the weights of (row, column), (row, column + 1) ...
RULE_COLUMNS = ("row", "column", "w00", "w01", "w10", "w11")


def columns_of(name: str, said: Sequence[str], config: Any) -> tuple[str, ...]:
    """Return the columns of a stream; ``said``: the names in its messages, ``config``: its node's."""
    fixed = {PLANT: PLANT_COLUMNS, PUSHES: PUSH_COLUMNS}.get(name)
    if fixed is not None:
        return fixed
    rules = RULE_COLUMNS if isinstance(config, RuleBaseConfig) else ()
    return ("t", *said, *rules)


def row_of(name: str, sample: JointSample) -> tuple[float, ...] | None:
    """Return a message as a row; None where it is not what the stream carries."""
    if sample.stamp_ns < 0:
        return None
    t = seconds(sample.stamp_ns)
    position, velocity, effort = sample.position, sample.velocity, sample.effort
    if name == PLANT:
        if not len(position) == len(velocity) == len(effort) == 2:
            return None
        return t, *position, *velocity, effort[1]
    if name == PUSHES:
        return (t, *effort) if len(effort) == 2 else None
    return (t, *position) if len(position) == len(sample.name) else None


def with_rules(
    row: tuple[float, ...], said: Sequence[str], config: RuleBaseConfig
) -> tuple[float, ...]:
    """Return a controller's row with the rules that fired for it; unchanged if it has no error and rate."""
    if "error" not in said or "error_rate" not in said:
        return row
    error, rate = row[1 + said.index("error")], row[1 + said.index("error_rate")]
    fired = fired_at(error, rate, *config.peaks)
    return (*row, fired[0].row, fired[0].column, *(rule.weight for rule in fired))
