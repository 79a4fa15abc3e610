"""What `trunk controller check-node` plays at a node, phase by phase, and how it judges the answers. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import cos, exp, inf, isfinite, sin
from typing import NamedTuple

from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.text import quoted_names
from trunk_msgs_util.units import NANOSECONDS, seconds

# The phases, in order. The first three are played twice, with a reset before the second time.
MOTION, REST, LARGE, GAP, REPEAT, SILENCE = "motion", "rest", "large", "gap", "repeat", "silence"
_TWICE = (MOTION, REST, LARGE)
_COUNTS = {MOTION: 100, REST: 10, LARGE: 20, GAP: 10}
_SKIPPED = 20  # states that are left out before the phase GAP
SILENT_S = 0.5


class Played(NamedTuple):
    """A state and its reference, as played; angles in rad, the hip's position in m."""

    phase: str
    again: bool  # True: the second time
    stamp_ns: int
    position: tuple[float, float]  # hip, trunk
    velocity: tuple[float, float]
    reference: float


def states_to_play(rate: float) -> Iterator[Played]:
    """Yield the states to play at ``rate`` Hz, without the silence and the reset between some of them.

    ::

        theta = 0.3 exp(-t) cos(4 t) in motion, 0 at rest, +-3 rad where it is large
    """
    period_ns = round(NANOSECONDS / rate)
    for again in (False, True):
        index = 0
        for phase in _TWICE:
            for _ in range(_COUNTS[phase]):
                yield _state(phase, again, index, period_ns)
                index += 1
        if again:
            return
        index += _SKIPPED
        for _ in range(_COUNTS[GAP]):
            yield _state(GAP, again, index, period_ns)
            index += 1
        yield _state(REPEAT, again, index - 1, period_ns)
        yield _state(SILENCE, again, index, period_ns)


def _state(phase: str, again: bool, index: int, period_ns: int) -> Played:
    stamp_ns = index * period_ns
    t = stamp_ns / NANOSECONDS
    decay = 0.3 * exp(-t)
    theta, rate = decay * cos(4.0 * t), -decay * (cos(4.0 * t) + 4.0 * sin(4.0 * t))
    if phase == REST:
        theta, rate = 0.0, 0.0
    if phase == LARGE:
        theta, rate = (3.0, 5.0) if index % 20 < 10 else (-3.0, -5.0)
    return Played(phase, again, stamp_ns, (t, theta), (1.0, rate), 0.0)


_CLOCK_NS = 10**18  # stamps beyond this are from a clock that counts from 1970


class TimedCommand(NamedTuple):
    """A command that came after a state was played, and before the next."""

    after_s: float  # since the last state was published
    command: JointSample
    late: bool = False  # it came after another state: on a busy machine, or by mistake


class Exchange(NamedTuple):
    """A state that was played, and what came then."""

    played: Played
    answers: tuple[TimedCommand, ...]


class NodeCheck(NamedTuple):
    """A check: what it asserts, what to write where that does not hold, and what is wrong; empty: nothing."""

    name: str
    asserts: str
    advice: str
    problem: Callable[[Transcript], str]


class Transcript(NamedTuple):
    """All that was exchanged with a node; ``limit``: its largest torque, N m, None: not known."""

    joint: str
    exchanges: Sequence[Exchange]
    limit: float | None

    def effort(self, command: JointSample) -> float | None:
        """Return a command's torque, N m; None where it has none for the joint."""
        if command.name.count(self.joint) != 1:
            return None
        place = command.name.index(self.joint)
        return command.effort[place] if place < len(command.effort) else None

    def efforts(self, again: bool, *phases: str) -> list[tuple[Played, float | None]]:
        """Return the states of some phases with the torque of the first answer, N m."""
        return [
            (played, self.effort(answers[0].command) if answers else None)
            for played, answers in self.exchanges
            if played.again == again and played.phase in phases
        ]

    @property
    def answers(self) -> list[tuple[Played, TimedCommand]]:
        """All commands, each with the state after which it came."""
        return [(e.played, answer) for e in self.exchanges for answer in e.answers]

    @property
    def latencies_s(self) -> list[float]:
        """How long the first answer to each state took, ascending."""
        return sorted(e.answers[0].after_s for e in self.exchanges if e.answers)


def findings(transcript: Transcript) -> list[tuple[NodeCheck, str]]:
    """Return each check with what is wrong, empty for nothing, as where it needs answers and has none."""
    return [(check, check.problem(transcript)) for check in CHECKS]


def _at(played: Played) -> str:
    return f"t = {seconds(played.stamp_ns):g} s"


def _answers(t: Transcript) -> str:
    asked = [e for e in t.exchanges if e.played.phase in _TWICE and not e.played.again]
    silent = [e for e in asked if not e.answers]
    if not silent:
        return ""
    return (
        f"{len(silent)} of {len(asked)} states have no answer, the first at {_at(silent[0].played)}"
    )


def _once(t: Transcript) -> str:
    often = [
        e for e in t.exchanges if len(e.answers) > 1 and e.played.phase not in (REPEAT, SILENCE)
    ]
    if not often:
        return ""
    played, answers = often[0]
    return f"{len(often)} states have several answers, {len(answers)} at {_at(played)}"


def _stamp(t: Transcript) -> str:
    late = sum(answer.late for _, answer in t.answers)
    if len(t.answers) > 20 and late > 0.9 * len(t.answers):
        return "the answers carry the stamp of an earlier state: they come after the next one"
    for played, answer in t.answers:
        stamp_ns = answer.command.stamp_ns
        if stamp_ns == played.stamp_ns:
            continue
        word = f"the stamp t = {seconds(stamp_ns):.9g} s"
        if stamp_ns == 0:
            word = "no stamp (0)"
        elif stamp_ns >= _CLOCK_NS:
            word = f"the wall clock's stamp, {seconds(stamp_ns):.0f} s"
        return f"the answer to {_at(played)} carries {word}"
    return ""


def _joint(t: Transcript) -> str:
    for _, (_, command, _) in t.answers:
        if t.effort(command) is None:
            names, count = quoted_names(command.name), len(command.effort)
            return f"the names are {names}, with {count} values of effort"
    return ""


def _finite(t: Transcript) -> str:
    words = {MOTION: "an ordinary state", LARGE: "a large angle"}
    for played, answer in t.answers:
        effort = t.effort(answer.command)
        if effort is not None and not isfinite(effort) and played.phase in words:
            return f"at {_at(played)}, {words[played.phase]}, the torque is {effort}"
    return ""


def _limits(t: Transcript) -> str:
    limit = inf if t.limit is None else t.limit
    for played, answer in t.answers:
        effort = t.effort(answer.command)
        if effort is not None and isfinite(effort) and abs(effort) > limit:
            return f"at {_at(played)} the torque is {effort:.6g} N m, beyond +-{limit:g} N m"
    return ""


def _rest(t: Transcript) -> str:
    for _, effort in t.efforts(False, REST):
        if effort is not None and not isfinite(effort):
            return f"at angle, rate and error 0 the torque is {effort}"
    return ""


def _gap(t: Transcript) -> str:
    after = [e for e in t.exchanges if e.played.phase == GAP]
    silent = [e for e in after if not e.answers]
    if silent and t.answers:
        return f"after 20 states were lost, {len(silent)} of {len(after)} states have no answer"
    if any(effort is not None and not isfinite(effort) for _, effort in t.efforts(False, GAP)):
        return "after 20 states were lost the torque is not finite"
    return ""


def _repeat(t: Transcript) -> str:
    for (_, first), (played, second) in pairwise(t.efforts(False, GAP, REPEAT)):
        if played.phase == REPEAT and _differ(first, second):
            return f"the same state a second time gives {second:.6g} N m, not {first:.6g} N m"
    return ""


def _silence(t: Transcript) -> str:
    for played, answers in t.exchanges:
        fresh = any(answer.command.stamp_ns != played.stamp_ns for answer in answers)
        if played.phase == SILENCE and fresh and len(answers) > 2:
            return f"{len(answers)} commands came in 0.5 s without a state, with stamps of no state"
    return ""


def _reset(t: Transcript) -> str:
    second = [e for e in t.exchanges if e.played.again]
    silent = [e for e in second if not e.answers]
    if not silent or not t.answers:
        return ""
    return f"after time went back to 0, {len(silent)} of {len(second)} states have no answer"


def _bits(t: Transcript) -> str:
    pairs = zip(t.efforts(False, *_TWICE), t.efforts(True, *_TWICE), strict=False)
    for (_, first), (played, second) in pairs:
        if _differ(first, second):
            return (
                f"the same states a second time, from t = 0 on, give {second!r} N m at {_at(played)}, "
                f"not {first!r} N m"
            )
    return ""


def _differ(first: float | None, second: float | None) -> bool:
    """Return True for two finite torques that are not equal."""
    both = first is not None and second is not None and isfinite(first) and isfinite(second)
    return both and first != second


def _latency(t: Transcript) -> str:
    times = t.latencies_s
    period_s = (t.exchanges[1].played.stamp_ns - t.exchanges[0].played.stamp_ns) / NANOSECONDS
    half_s = times[len(times) // 2] if times else 0.0
    if half_s <= period_s:
        return ""
    return (
        f"half of the answers take longer than {1e3 * half_s:.3g} ms, and a period is "
        f"{1e3 * period_s:.3g} ms"
    )


CHECKS = (
    NodeCheck(
        "answers",
        "every state has an answer",
        "publish one command in the callback of joint_states, for each state",
        _answers,
    ),
    NodeCheck("once", "no state has two", "publish in one place only, and subscribe once", _once),
    NodeCheck(
        "stamp",
        "a command carries the stamp of the state that it answers",
        "copy header.stamp of the state that is being answered",
        _stamp,
    ),
    NodeCheck(
        "joint",
        "it names the joint, once, with an effort",
        "give name = [the joint], effort = [torque in N m]",
        _joint,
    ),
    NodeCheck(
        "finite",
        "the torque is a finite number, also at large angles",
        "limit it, and check it before it is published",
        _finite,
    ),
    NodeCheck("limits", "it is within the limit that --limit gives", "clamp the command", _limits),
    NodeCheck(
        "rest",
        "angle, rate and error 0 are an ordinary state",
        "divide by nothing that can be 0",
        _rest,
    ),
    NodeCheck(
        "gap",
        "it goes on after lost states",
        "go on with the next state, whatever its stamp, and take dt from the stamps",
        _gap,
    ),
    NodeCheck(
        "repeat",
        "a state that comes twice changes nothing",
        "ignore a state whose stamp is not newer: a link may deliver it twice",
        _repeat,
    ),
    NodeCheck(
        "silence",
        "without states it gives no new commands",
        "command only in answer to a state: what is older than command_timeout must not act",
        _silence,
    ),
    NodeCheck(
        "reset",
        "it goes on when time goes back to 0",
        "start anew when a stamp goes back: the simulator was restarted",
        _reset,
    ),
    NodeCheck(
        "bits",
        "the same states give the same bits",
        "clear the memory when a stamp goes back, or offer ~/reset (std_srvs/Trigger); no clock, no "
        "randomness",
        _bits,
    ),
    NodeCheck(
        "latency",
        "it answers within a period",
        "answer in the callback, without a timer or a queue",
        _latency,
    ),
)
