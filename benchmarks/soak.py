"""What a long real-time run must show: memory that does not grow, and every missed step counted.

A step is missed if it was not driven by the answer to its own state. The record shows this
without any clock: the next true state carries the torque over a step, the command with
the step's stamp carries the answer. The simulator counts the same steps while it runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util import topics
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.units import seconds
from trunk_sim.config import SimulatorConfig

SETTLED_S = 60.0
MAX_GROWTH = 0.02
# The index is written at the end of an MCAP file: until then a recorder holds every chunk's entry. With
# two chunks a second and six topics that was 1.9 kB/s.
INDEX_BYTES_PER_S = 2000.0
UNANSWERED, LATE = "states unanswered", "commands late"
IDLE, OVERDUE = "steps without a fresh command", "deadlines missed"
# The difference of two log times includes both messages' way to the recorder.
_LOG_TOLERANCE_S = 1.0


def settled_at(duration_s: float) -> float:
    """Return the time in s after which memory must be flat: 60 s, or half of a shorter run.

    Publishers keep their last 5000 messages: at 200 Hz a node is expected to grow for 25 s.
    """
    return min(SETTLED_S, duration_s / 2.0)


@dataclass(frozen=True)
class Growth:
    """A node's settled memory in bytes, and its maximum since, without a recorder's index."""

    node: str
    settled: float
    most: float

    @property
    def ratio(self) -> float:
        """Growth as a fraction of the settled memory."""
        return self.most / self.settled - 1.0


def growth(node: str, samples: Sequence[tuple[float, int]], settled_s: float) -> Growth:
    """Return the growth of a node's memory from ``(s, bytes)`` samples in order.

    The settled memory is the median of the first tenth of the samples from ``settled_s`` on. The size
    of a recorder's index is subtracted. Raises ValueError if there are no such samples.
    """
    index = INDEX_BYTES_PER_S if node == "recorder" else 0.0
    later = [size - index * (t - settled_s) for t, size in samples if t >= settled_s]
    if not later:
        raise ValueError(f"{node}: no sample of its memory after {settled_s:g} s")
    return Growth(node, median(later[: max(len(later) // 10, 1)]), max(later))


@dataclass(frozen=True)
class Steps:
    """What a record shows about a run's steps."""

    states: int
    unanswered: int  # states without a command
    late: int  # steps made before the command answering their state arrived
    idle: int  # steps after the first torque made with none, contrary to their command
    lost_s: float  # by how much the wall clock ran ahead of the stamps


def steps_of(recording: Recording) -> Steps:
    """Return the counts of steps in the record of a real-time run; its controller answers every state.

    Raises ValueError if the run has fewer than two states.
    """
    run = RecordedRun(recording)
    config: SimulatorConfig = run.config("simulator")
    trunk = config.joints[1]
    joints = {
        name: run.joints(name).by_stamp() for name in (topics.GROUND_TRUTH, topics.EFFORT_COMMAND)
    }
    truth, commands = joints[topics.GROUND_TRUTH], joints[topics.EFFORT_COMMAND]
    if len(truth) < 2:
        raise ValueError(f"{recording.path}: {len(truth)} states are recorded, 2 are needed")
    answered = np.isin(truth.stamp_ns, commands.stamp_ns)
    own = np.full(len(truth), np.nan)
    own[answered] = commands.column("effort", trunk)[np.isin(commands.stamp_ns, truth.stamp_ns)]
    wanted = np.clip(own, -config.max_effort, config.max_effort)[:-1]
    applied = truth.column("effort", trunk)[1:]
    other = applied != wanted
    begun = np.cumsum(applied != 0.0) > 0
    return Steps(
        states=len(truth),
        unanswered=int((~answered).sum()),
        late=int((other & answered[:-1]).sum()),
        idle=int((other & begun & (applied == 0.0)).sum()),
        lost_s=seconds(int(np.ptp(truth.log_time_ns) - np.ptp(truth.stamp_ns))),
    )


def problems_of_memory(growths: Sequence[Growth], allowed: float = MAX_GROWTH) -> list[str]:
    """Return a line for each node that grew by more than the allowed fraction."""
    return [
        f"{g.node}: memory grew by {g.ratio:.1%} from {g.settled / 2**20:.1f} MiB; "
        f"less than {allowed:.0%} is allowed"
        for g in growths
        if g.ratio >= allowed
    ]


def problems_of_steps(steps: Steps, counted: Mapping[str, int], period_s: float) -> list[str]:
    """Return a line for each kind of missed step that the record shows more often than counted.

    A command that was recorded, but displaced from the simulator's full queue, counts as late in the record
    and as unanswered in the simulator: its surplus of unanswered steps is set against late ones.
    """
    problems = []
    unanswered, late = counted.get(UNANSWERED, 0), counted.get(LATE, 0)
    displaced = max(unanswered - steps.unanswered, 0)
    pairs = {
        UNANSWERED: (steps.unanswered, unanswered),
        LATE: (steps.late, late + displaced),
        IDLE: (steps.idle, counted.get(IDLE, 0)),
    }
    for name, (shown, count) in pairs.items():
        if shown > count:
            problems.append(f"{name}: the record shows {shown}, /diagnostics counted {count}")
    overdue_s = counted.get(OVERDUE, 0) * period_s
    if steps.lost_s > overdue_s + _LOG_TOLERANCE_S:
        problems.append(
            f"the run took {steps.lost_s:.1f} s longer than its stamps say; the {OVERDUE} that "
            f"/diagnostics counted explain {overdue_s:.1f} s"
        )
    return problems


def problems_of_file(recording: Recording) -> list[str]:
    """Return the problems that keep the file from being a whole, verified run."""
    verdict = verify(recording)
    if verdict.exit_code == VERIFIED:
        return []
    return [f"{recording.path}: {verdict.word}: {'; '.join(verdict.reasons)}"]
