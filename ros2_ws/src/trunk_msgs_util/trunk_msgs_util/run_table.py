"""`RunTable`: a run as aligned columns, one row per true state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import topics
from .joint_arrays import Floats, Integers, JointArrays
from .recording import Recording, RecordingError
from .units import NANOSECONDS

CSV_COLUMNS = (
    "t",
    "x",
    "theta",
    "x_dot",
    "theta_dot",
    "theta_measured",
    "reference",
    "torque",
    "kp",
    "ki",
    "kd",
)
_CSV_ROWS = 8192  # written at a time
_HELD = ("reference", "kp", "ki", "kd", "alpha")


@dataclass(frozen=True)
class RunTable:
    """Columns [N + 1] at the stamps of the true states; NaN where the run does not say.

    ``torque[k]`` is what was applied over [t_k, t_k+1). Reference and gains are those of the
    controller's last update, at t_k or before.
    """

    t: Floats  # s
    x: Floats  # m
    theta: Floats  # rad
    x_dot: Floats  # m/s
    theta_dot: Floats  # rad/s
    theta_measured: Floats  # rad
    reference: Floats  # rad
    torque: Floats  # N m
    kp: Floats  # N m/rad
    ki: Floats  # N m/(rad s)
    kd: Floats  # N m s/rad
    alpha: Floats

    @classmethod
    def from_recording(cls, recording: Recording) -> RunTable:
        """Return a recorded run, matched by stamps. Raises RecordingError without true states."""

        def read(relative: str) -> JointArrays:
            return recording.joints(recording.topic(relative)).by_stamp()

        truth = read(topics.GROUND_TRUTH)
        if not len(truth):
            raise RecordingError(
                f"{recording.path} has no messages on {recording.topic(topics.GROUND_TRUTH)}: "
                "record a run with the simulator in it"
            )
        hip, trunk = _joints(recording, truth)
        at = truth.stamp_ns
        measured = read(topics.JOINT_STATES)
        command = read(topics.EFFORT_COMMAND)
        controller = recording.controller
        state = read(topics.controller_state(controller)) if controller else _NOTHING
        held = {name: _held(at, state.stamp_ns, state.column("position", name)) for name in _HELD}

        # A true state tells the torque of the step before it; only the last step's is not told.
        torque = np.append(truth.column("effort", trunk)[1:], np.nan)
        last = _matched(at[-1:], command.stamp_ns, command.column("effort", trunk))
        limit = _max_effort(recording, int(at[-1]))
        torque[-1] = truth.column("effort", trunk)[-1] if np.isnan(last[0]) else last[0]
        torque[-1] = np.clip(torque[-1], -limit, limit)
        return cls(
            t=at / NANOSECONDS,
            x=truth.column("position", hip),
            theta=truth.column("position", trunk),
            x_dot=truth.column("velocity", hip),
            theta_dot=truth.column("velocity", trunk),
            theta_measured=_matched(at, measured.stamp_ns, measured.column("position", trunk)),
            torque=torque,
            **held,
        )

    def write_csv(self, path: str | Path) -> None:
        """Write `CSV_COLUMNS`, a row per state; every number reads back to the same double."""
        columns = [getattr(self, name) for name in CSV_COLUMNS]
        with Path(path).open("w", encoding="ascii", newline="") as file:
            file.write(",".join(CSV_COLUMNS) + "\n")
            for start in range(0, len(self.t), _CSV_ROWS):
                rows = np.column_stack([c[start : start + _CSV_ROWS] for c in columns]).tolist()
                file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


_NO_STAMPS: Integers = np.empty(0, np.int64)
_NOTHING = JointArrays((), _NO_STAMPS, _NO_STAMPS, *(np.empty((0, 0)) for _ in range(3)))


def _held(at: Integers, stamps: Integers, values: Floats) -> Floats:
    """Return the last of the values at or before each stamp, NaN before the first."""
    rows = np.searchsorted(stamps, at, side="right")
    return np.append(np.nan, values)[rows]


def _matched(at: Integers, stamps: Integers, values: Floats) -> Floats:
    """Return the values that have exactly the stamps, NaN where there is none."""
    rows = np.searchsorted(stamps, at, side="right")
    found = np.append(-1, stamps)[rows] == at
    return np.where(found, np.append(np.nan, values)[rows], np.nan)


def _joints(recording: Recording, truth: JointArrays) -> tuple[str, str]:
    """Return the names of the hip's and the trunk's joint."""
    told = recording.parameters().get(recording.topic("simulator"), {}).get("joints")
    if isinstance(told, tuple) and len(told) == 2:
        joints = str(told[0]), str(told[1])
    elif {"hip", "trunk"} <= set(truth.names) or len(truth.names) < 2:
        joints = "hip", "trunk"
    else:
        joints = truth.names[0], truth.names[1]
    for name in joints:
        if name not in truth.names:
            raise RecordingError(
                f"{recording.path}: {recording.topic(topics.GROUND_TRUTH)} has no joint {name!r} "
                f"but {', '.join(truth.names)}: set the parameter joints to its names"
            )
    return joints


def _max_effort(recording: Recording, stamp_ns: int) -> float:
    """Return the actuator's limit in N m at a state's stamp; infinite where it is not recorded."""
    node = recording.topic("simulator")
    limit = recording.parameters().get(node, {}).get("max_effort", np.inf)
    for change in recording.parameter_changes():
        if change.node == node and change.stamp_ns < stamp_ns:
            limit = change.changed.get("max_effort", limit)
    return limit if isinstance(limit, float) else np.inf
