"""What a record has for the plant's replay: torques that were held, and messages row by row."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from trunk_msgs_util.recording.joint_arrays import Floats, Integers
from trunk_msgs_util.units import nanoseconds
from trunk_sim.config import SimulatorConfig
from trunk_sim.step import in_force

from ..recorded.joint_table import JointTable
from ..recorded.run import RecordedRun
from ..recorded.turns import idle_ns

QUANTITIES = ("position", "velocity", "effort")


def held(run: RecordedRun, commands: JointTable) -> dict[int, float]:
    """Return the torques over the steps from states that no controller was to answer, N m."""
    idle = idle_ns(run).tolist()
    told = sorted(commands.rows) if idle else []
    timeline = run.timeline("simulator")
    found: dict[int, float] = {}
    for stamp_ns in idle:
        timeline.advance(stamp_ns + 1)
        found[stamp_ns] = latest_in_force(commands, told, stamp_ns, timeline.config)
    return found


def latest_in_force(
    commands: JointTable, told: Sequence[int], stamp_ns: int, config: SimulatorConfig
) -> float:
    """Return the torque of the last command up to a stamp, N m; ``told``: the commands' stamps, ascending."""
    row = bisect_right(told, stamp_ns) - 1
    if row < 0:
        return 0.0
    effort = commands.get(told[row], "effort", 1)[0]
    return in_force(effort, stamp_ns - told[row], nanoseconds(config.command_timeout))


def is_whole(table: JointTable) -> bool:
    return all(table.widths[quantity] == 2 for quantity in QUANTITIES)


def by_row(table: JointTable, stamps: Integers) -> Floats:
    """Return positions, velocities and efforts [N, 6] at these stamps, NaN without a message."""
    rows = table.rows_of(stamps)
    return np.hstack([filled(table.values(quantity), rows) for quantity in QUANTITIES])


def filled(values: Floats, rows: Integers) -> Floats:
    found = np.full((len(rows), values.shape[1]), np.nan)
    found[rows >= 0] = values[rows[rows >= 0]]
    return found
