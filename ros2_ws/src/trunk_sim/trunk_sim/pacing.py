"""When the plant steps: by the wall clock (real time), or once every participant has answered (lock-step).

Pure: time comes in as integers, the loop is reached through `Loop`; the simulator node is the shell.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping
from typing import Protocol

from trunk_core import topics
from trunk_core.deadline import patience
from trunk_core.units import nanoseconds, seconds
from trunk_msgs_util.source import ARRIVAL, CLOCK_STAMP, NO_STAMP, ODD_STAMP

from .config import SimulatorConfig
from .inputs import NO_COMMAND, Command
from .step import too_old

# Under which names answers are counted that may come from a second controller.
LATE_ANSWER, DOUBLED_ANSWER, OUT_OF_ORDER = DOUBLED = (
    "late answers ignored",
    "doubled answers ignored",
    "commands out of order",
)
# If it is further behind the wall clock than this, it does not catch up: time is re-anchored.
MAX_CATCH_UP = 50
_SETTLED_GAPS = 50
# Stamps beyond this, ns, are from a clock that counts from 1970: no run lasts for 30 years.
WALL_CLOCK_NS = 10**18
_TICK_S = 0.05


class Loop(Protocol):
    """What pacing needs of the simulator."""

    @property
    def stamp_ns(self) -> int:
        """Simulated time of the published state, ns."""

    @property
    def period_ns(self) -> int:
        """The plant's period, ns."""

    @property
    def at_end(self) -> bool:
        """True where the published state is the run's last."""

    def advance(self, effort: float) -> None:
        """Step with this effort, N m, and publish the new state."""

    def finish(self) -> None:
        """End the run: the last state is answered."""

    def fail(self, reason: str) -> None:
        """End the run with an error."""

    def count(self, kind: str, number: int = 1) -> None:
        """Count something for diagnostics."""

    def refuse(self, kind: str, why: str) -> None:
        """Count a message that is not used as it was meant, and say why."""

    def participant(self, topic: str) -> str:
        """Return who answers on a topic, as readable text."""


class Pacing(ABC):
    """Takes commands and clock ticks, and advances the loop."""

    def __init__(self, loop: Loop) -> None:
        self._loop = loop
        self._anchor_ns = 0  # wall time of simulated time zero
        self.worst_late_ns = 0
        self.paused = True  # until it begins

    def begin(self, now_ns: int) -> None:
        """Start, or resume after a pause, at this wall time; the state is published."""
        self.paused = False
        self._anchor_ns = now_ns - self._wall(self._loop.stamp_ns)

    def _wall(self, duration_ns: int) -> int:
        return duration_ns

    def set_timeout(self, command_timeout: float) -> None:  # noqa: B027
        """Use no command that answers a state older than this, s; ignored in lock-step."""

    def set_speed(self, speed: float, now_ns: int) -> None:  # noqa: B027
        """Go on at another multiple of real time from this wall time; ignored in real time."""

    def narrow(self, topic: str, window_ns: int) -> None:  # noqa: B027
        """Let a participant's answer lag the state by no more than this; ignored in real time."""

    def answered(self, topic: str, stamp_ns: int, now_ns: int) -> None:  # noqa: B027
        """Note that a participant has answered up to this stamp; ignored in real time."""

    @property
    def command_in_use(self) -> Command:
        """The command that acts over the step from the published state; known in real time alone."""
        return NO_COMMAND

    @abstractmethod
    def command(self, stamp_ns: int, effort: float, now_ns: int, source: str = "") -> None:
        """Take in a finite command that answers the state with this stamp."""

    @abstractmethod
    def tick(self, now_ns: int) -> None:
        """Do what is due at this wall time; called about once a period."""


class RealTimePacing(Pacing):
    """Steps follow the wall clock; the latest command counts unless it is older than the timeout."""

    def __init__(self, loop: Loop, command_timeout: float) -> None:
        super().__init__(loop)
        self.set_timeout(command_timeout)
        self._latest = NO_COMMAND
        # Between answered states; 0: not known yet.
        self._gap_ns = self._last_gap_ns = 0
        self._same_gaps = 0
        self._strangers_gaps: Counter[int] = Counter()

    def set_timeout(self, command_timeout: float) -> None:
        """Use no command that answers a state older than this, s."""
        self._timeout_ns = nanoseconds(command_timeout)

    def command(self, stamp_ns: int, effort: float, now_ns: int, source: str = "") -> None:
        """Take the command if it is newer than the last.

        One of a node that is not ours, stamped otherwise than any state so far, acts from its arrival.
        """
        if not source:
            self._strangers_command(stamp_ns, effort)
            return
        if stamp_ns <= self._latest.stamp_ns or stamp_ns > self._loop.stamp_ns:
            self._loop.count(OUT_OF_ORDER)
            return
        if stamp_ns < self._loop.stamp_ns:
            self._loop.count("commands late")  # the step from that state was made without it
        self._count_unanswered(stamp_ns)
        self._latest = Command(stamp_ns, effort, source)

    def _strangers_command(self, stamp_ns: int, effort: float) -> None:
        now = self._loop.stamp_ns
        if not self._is_of_a_state(stamp_ns):
            kind, fault = no_states_stamp(stamp_ns, now)
            self._loop.refuse(
                kind, f"they act when they arrive, and lateness cannot be judged, as {fault}"
            )
            self._latest = Command(now, effort, ARRIVAL)
            return
        arrived = (
            self._latest.source == ARRIVAL
        )  # in this state perhaps: its answer counts for more
        if stamp_ns < self._latest.stamp_ns + (not arrived):
            repeated = stamp_ns == self._latest.stamp_ns
            self._loop.count("repeated answers ignored" if repeated else OUT_OF_ORDER)
            return
        gaps = self._strangers_gaps
        if self._latest.stamp_ns >= 0 and not arrived:
            gaps[(stamp_ns - self._latest.stamp_ns) // self._loop.period_ns] += 1
        usual = gaps.most_common(1)[0][0] if gaps.total() >= _SETTLED_GAPS else 0
        if usual == 1 and stamp_ns < now:  # one at a rate of its own is late for no state
            self._loop.count("commands late")
        if usual:
            missed = (stamp_ns - self._latest.stamp_ns) // (usual * self._loop.period_ns) - 1
            if missed > 0:
                self._loop.count("states unanswered", missed)
        self._latest = Command(stamp_ns, effort, "")

    def _is_of_a_state(self, stamp_ns: int) -> bool:
        """Return True if a stranger's stamp is a published state's; 0 may also be that of no stamp."""
        now = self._loop.stamp_ns
        if stamp_ns == 0:
            return now == 0 or (self._latest.stamp_ns < 0 and now <= self._timeout_ns)
        return 0 < stamp_ns <= now and stamp_ns % self._loop.period_ns == 0

    def _count_unanswered(self, stamp_ns: int) -> None:
        """Count the states between the last answered one and this one that should have been answered.

        A controller slower than the plant answers every n-th state: its gap is the smallest one seen. A
        wider gap that stays the same for `_SETTLED_GAPS` answers belongs to a slower controller that has
        taken over: what was counted in it is subtracted. On a busy machine a controller may well miss
        every other state for a while.
        """
        if self._latest.stamp_ns < 0:
            missed = stamp_ns // self._loop.period_ns
        else:
            gap_ns = stamp_ns - self._latest.stamp_ns
            self._same_gaps = self._same_gaps + 1 if gap_ns == self._last_gap_ns else 1
            self._last_gap_ns = gap_ns
            if not self._gap_ns or gap_ns < self._gap_ns:
                self._gap_ns = gap_ns
            missed = gap_ns // self._gap_ns - 1
            if missed > 0 and self._same_gaps == _SETTLED_GAPS:
                self._gap_ns = gap_ns
                missed = -missed * (_SETTLED_GAPS - 1)
        if missed:
            self._loop.count("states unanswered", missed)

    def tick(self, now_ns: int) -> None:
        """Make every step that is due; at the last state, wait for its answer up to the timeout."""
        if self.paused:
            return
        loop = self._loop
        period = loop.period_ns
        late = now_ns - self._anchor_ns - loop.stamp_ns - period
        if loop.at_end:
            if self._latest.stamp_ns < loop.stamp_ns and late <= self._timeout_ns:
                return
            if self._latest.source or self._latest.stamp_ns < 0:
                self._count_unanswered(loop.stamp_ns + (self._gap_ns or period))
            loop.finish()
            return
        if late >= period:
            loop.count("deadlines missed", late // period)
            if late > MAX_CATCH_UP * period:
                self._anchor_ns += late
                late = 0
        self.worst_late_ns = max(self.worst_late_ns, late)
        for _ in range(1 + max(late, 0) // period):
            if not loop.at_end:
                loop.advance(self._effort_in_use())

    @property
    def command_in_use(self) -> Command:
        """The command that acts over the step from the published state: the latest, unless it is too old."""
        age_ns = self._loop.stamp_ns - self._latest.stamp_ns
        return NO_COMMAND if too_old(age_ns, self._timeout_ns) else self._latest

    def _effort_in_use(self) -> float:
        command = self.command_in_use
        if command is not self._latest:
            self._loop.count("steps without a fresh command")
        return command.effort


def no_states_stamp(stamp_ns: int, now_ns: int) -> tuple[str, str]:
    """Return under which name a command is counted that answers no state by its stamp, and the reason."""
    if stamp_ns == 0:
        kind, stamp = NO_STAMP, "they carry no stamp"
    elif stamp_ns >= WALL_CLOCK_NS:
        kind, stamp = CLOCK_STAMP, "they carry the wall clock's stamps"
    else:
        at = f"t = {seconds(stamp_ns):.9g} s, while the state is at t = {seconds(now_ns):.9g} s"
        kind, stamp = ODD_STAMP, f"they carry stamps of no state ({at})"
    return kind, f"{stamp}: copy header.stamp of the state that a command answers"


class LockstepPacing(Pacing):
    """The plant leaves state k once every participant has answered it, however long that takes.

    ``answers``: the stamp up to which each awaited topic has answered. ``speed`` > 0 paces the run at
    that multiple of real time; 0 runs as fast as the machine allows. ``windows``: how far, in ns, a
    participant's answer may lag the state: 0 for a controller, positive for the recorder, minus one
    period for the disturbance, which answers for the next state.
    """

    def __init__(
        self, loop: Loop, windows: Mapping[str, int], timeout: float, speed: float
    ) -> None:
        super().__init__(loop)
        self._windows = dict(windows)
        self._timeout = timeout
        self._timeout_ns = nanoseconds(timeout * patience())
        self._speed = speed
        self._answered = dict.fromkeys(windows, -1)
        self._effort = 0.0
        self._waiting_since_ns = 0
        self._unstamped = 0  # commands without a stamp since the last answer

    def _wall(self, duration_ns: int) -> int:
        return round(duration_ns / self._speed) if self._speed > 0.0 else 0

    def narrow(self, topic: str, window_ns: int) -> None:
        """Let a participant's answer lag the state by no more than this."""
        if topic in self._windows:
            self._windows[topic] = min(self._windows[topic], window_ns)

    def set_speed(self, speed: float, now_ns: int) -> None:
        """Go on at another multiple of real time from this wall time; 0: as fast as possible."""
        self._speed = speed
        self._anchor_ns = now_ns - self._wall(self._loop.stamp_ns)

    def begin(self, now_ns: int) -> None:
        """Start or resume: the timeout starts afresh."""
        super().begin(now_ns)
        self._waiting_since_ns = now_ns
        self._advance(now_ns)

    def command(self, stamp_ns: int, effort: float, now_ns: int, source: str = "") -> None:
        """Take the first answer to the current state; count and ignore any other.

        A stamp that no state can have ends the run: its sender does not answer states.
        """
        now = self._loop.stamp_ns
        if stamp_ns % self._loop.period_ns or stamp_ns >= WALL_CLOCK_NS:
            who = self._loop.participant(topics.EFFORT_COMMAND)
            self._loop.fail(
                f"{who}: in lock-step its commands must answer states, but "
                f"{no_states_stamp(stamp_ns, now)[1]}"
            )
            return
        self._unstamped = self._unstamped + 1 if stamp_ns == 0 < now else 0
        if stamp_ns < now:
            self._loop.count(LATE_ANSWER)
        elif stamp_ns > now:
            self._loop.count("answers to no state ignored")
        elif self._answered["effort_command"] == now:
            self._loop.count(DOUBLED_ANSWER)
        else:
            self._effort = effort
            self.answered("effort_command", stamp_ns, now_ns)

    def answered(self, topic: str, stamp_ns: int, now_ns: int) -> None:
        """Note that a participant has answered up to this stamp."""
        if stamp_ns > self._answered.get(topic, stamp_ns):
            self._answered[topic] = stamp_ns
            self._advance(now_ns)

    def silent(self) -> list[str]:
        """Return the topics that the current state still waits for."""
        now, end = self._loop.stamp_ns, self._loop.at_end
        return [
            topic
            for topic, stamp in self._answered.items()
            # The last state waits for everything: nothing may be in flight when the run ends.
            if stamp < now - (min(self._windows[topic], 0) if end else self._windows[topic])
        ]

    def _advance(self, now_ns: int) -> None:
        loop = self._loop
        if self.paused or self.silent():
            return
        due_ns = self._anchor_ns + self._wall(loop.stamp_ns + loop.period_ns)
        if self._speed > 0.0 and now_ns < due_ns:
            return
        if loop.at_end:
            loop.finish()
            return
        self._waiting_since_ns = now_ns
        loop.advance(self._effort)

    def tick(self, now_ns: int) -> None:
        """Step if only the pace was holding it back; give up on a participant that is silent for too long."""
        if self.paused:
            return
        silent = self.silent()
        if not silent:
            self._advance(now_ns)
        elif now_ns - self._waiting_since_ns > self._timeout_ns:
            unstamped = ""
            if self._unstamped and topics.EFFORT_COMMAND in silent:
                unstamped = (
                    f"; {self._unstamped} commands came without a stamp: "
                    "copy header.stamp of the state that a command answers"
                )
            self._loop.fail(
                f"no answer from {', '.join(map(self._loop.participant, silent))} to the state at "
                f"t = {seconds(self._loop.stamp_ns):g} s within lockstep.timeout = "
                f"{self._timeout:g} s{unstamped}"
            )


def make_pacing(loop: Loop, config: SimulatorConfig) -> Pacing:
    """Return the pacing that a configuration asks for."""
    if not config.lockstep:
        return RealTimePacing(loop, config.command_timeout)
    period = config.period_ns
    windows = {
        topics.EFFORT_COMMAND: 0,
        topics.DISTURBANCE: -period,
        topics.REFERENCE: -period,
        "recorder": config.lockstep_window * period,
    }
    return LockstepPacing(
        loop,
        {name: windows[name] for name in config.wait_for},
        config.lockstep_timeout,
        config.lockstep_speed,
    )


def tick_period(config: SimulatorConfig) -> float:
    """Return how often the pacing is to be called, in s of wall time."""
    period = seconds(config.period_ns)
    if not config.lockstep:
        return period
    if config.lockstep_speed:
        return min(period / config.lockstep_speed, _TICK_S)
    return _TICK_S
