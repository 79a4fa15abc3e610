"""Lock-step: the plant steps once every participant has answered; and which pacing a run gets. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from trunk_msgs_util import topics
from trunk_msgs_util.cpu_deadline import READ_FROM
from trunk_msgs_util.units import NANOSECONDS, seconds

from .config import SimulatorConfig
from .pacing import WALL_CLOCK_NS, Loop, Pacing, RealTimePacing, no_states_stamp

_TICK_S = 0.05


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
        self._speed = speed
        self._answered = dict.fromkeys(windows, -1)
        self._effort = 0.0
        self._waiting_since_ns: int | None = None
        self._waited_since_ns: int | None = None  # as of the last tick
        self._waited_ns = self._ticked_ns = 0
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
            self._loop.count("late answers ignored")
        elif stamp_ns > now:
            self._loop.count("answers to no state ignored")
        elif self._answered["effort_command"] == now:
            self._loop.count("doubled answers ignored")
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
        elif self._waiting_since_ns is not None and self._gives_up(silent, now_ns):
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

    def _gives_up(self, silent: Sequence[str], now_ns: int) -> bool:
        """Return True if these could have answered in time: no busy machine held them up."""
        if self._waited_since_ns != self._waiting_since_ns:
            self._waited_since_ns = self._ticked_ns = self._waiting_since_ns or 0
            self._waited_ns = 0
        wall_ns, self._ticked_ns = now_ns - self._ticked_ns, now_ns
        timeout_ns = self._timeout * NANOSECONDS
        soon = self._waited_ns < timeout_ns * READ_FROM
        self._waited_ns += wall_ns - self._loop.scheduling_delay_ns(() if soon else silent, wall_ns)
        return self._waited_ns > timeout_ns


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
