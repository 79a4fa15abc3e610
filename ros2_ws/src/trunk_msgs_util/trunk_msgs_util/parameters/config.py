"""The parameters that every node declares, and those of the recorder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .. import topics
from .declarations import parameter


def rate_parameter(
    description: str = "Rate of the plant's steps; the period is 1/rate, rounded to whole ns",
) -> Any:
    """Return the declaration of a node's ``update_rate``."""
    return parameter(
        "update_rate", 200.0, description, unit="Hz", minimum=0.001, maximum=1e6, fixed=True
    )


def lockstep_parameter(description: str) -> Any:
    """Return the declaration of ``lockstep.enabled``, with what it makes this node do."""
    return parameter("lockstep.enabled", False, description, fixed=True)


@dataclass(frozen=True)
class ManagedConfig:
    """The parameters that every node declares: all are managed (lifecycle) nodes."""

    autostart: bool = parameter(
        "autostart",
        True,
        "Configure and activate at start; false: wait for someone to do it, e.g. with `ros2 lifecycle set`",
        fixed=True,
    )


@dataclass(frozen=True)
class RecorderConfig(ManagedConfig):
    """Parameters of the ``recorder`` node."""

    output: str = parameter(
        "output",
        "",
        "File to write, NAME.mcap; empty: trunk_<UTC time>.mcap in the working directory",
        fixed=True,
    )
    overwrite: bool = parameter("overwrite", False, "Replace the file if it exists", fixed=True)
    controllers: tuple[str, ...] = parameter(
        "controllers",
        (),
        "Controllers of the plan, for the record; the ~/state of every node that publishes one is recorded",
        element=str,
        fixed=True,
    )
    scenario: str = parameter("scenario", "", "Name of the scenario, for the record", fixed=True)
    lockstep: bool = lockstep_parameter(
        "The plant waits until its states are written; messages are logged in simulated time"
    )
    lockstep_topics: tuple[str, ...] = parameter(
        "lockstep.topics",
        (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND),
        "Topics that carry one message per step; the plant waits until they are written",
        element=str,
        fixed=True,
    )

    markers: bool = parameter(
        "markers",
        False,
        "Record the run's picture too, for 3-D views: markers, tf and robot_description, 30 times a second",
        fixed=True,
    )

    @property
    def mode(self) -> str:
        """How the run keeps time, for the record."""
        return "lockstep" if self.lockstep else topics.REAL_TIME
