"""What `trunk controller check-node` plays at a node, phase by phase, and how it judges the answers. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import cos, exp, isfinite, sin
from typing import Annotated, NamedTuple

from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.text import quoted_names
from trunk_msgs_util.units import NANOSECONDS, seconds

from ..results import OMITTED, Named

# The phases, in order. The first three are played twice, with a reset before the second time.
MOTION, REST, LARGE, GAP, REPEAT, SILENCE, RESET = (
    "motion",
    "rest",
    "large",
    "gap",
    "repeat",
    "silence",
    "reset",
)
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
        for phase in (MOTION, REST, LARGE):
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


class NodeFinding(NamedTuple):
    """What a node does otherwise than it should, and what to write instead."""

    check: Annotated[str, OMITTED]
    problem: Annotated[str, Named("what")]
    advice: str


class NodeCheck(NamedTuple):
    """A check: its name, what it asserts, and its function of what was exchanged."""

    name: str
    asserts: str
    run: Callable[[Transcript], Iterator[NodeFinding]]


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

    def efforts(self, again: bool, phases: Sequence[str]) -> list[float | None]:
        """Return the torque of the first answer to each state of some phases, N m."""
        return [
            self.effort(exchange.answers[0].command) if exchange.answers else None
            for exchange in self.exchanges
            if exchange.played.again == again and exchange.played.phase in phases
        ]

    @property
    def commands(self) -> list[JointSample]:
        """All commands."""
        return [answer.command for exchange in self.exchanges for answer in exchange.answers]

    @property
    def latencies_s(self) -> list[float]:
        """How long the first answer to each state took, ascending."""
        return sorted(
            exchange.answers[0].after_s for exchange in self.exchanges if exchange.answers
        )


def findings(transcript: Transcript) -> list[tuple[NodeCheck, list[NodeFinding]]]:
    """Return each check's findings. Checks that need answers find nothing where there is none."""
    return [(check, list(check.run(transcript))) for check in CHECKS]


def _at(played: Played) -> str:
    return f"t = {seconds(played.stamp_ns):g} s"


def _answers(t: Transcript) -> Iterator[NodeFinding]:
    asked = [exchange for exchange in t.exchanges if exchange.played.phase in (MOTION, REST, LARGE)]
    silent = [exchange for exchange in asked if not exchange.played.again and not exchange.answers]
    if silent:
        count = sum(not exchange.played.again for exchange in asked)
        yield NodeFinding(
            "answers",
            f"{len(silent)} of {count} states have no answer, the first at {_at(silent[0].played)}",
            "publish one command in the callback of joint_states, for each state",
        )


def _once(t: Transcript) -> Iterator[NodeFinding]:
    often = [
        exchange
        for exchange in t.exchanges
        if len(exchange.answers) > 1 and exchange.played.phase not in (REPEAT, SILENCE)
    ]
    if often:
        first = often[0]
        yield NodeFinding(
            "once",
            f"{len(often)} states have several answers, {len(first.answers)} at {_at(first.played)}",
            "publish in one place only, and subscribe once",
        )


def _stamp(t: Transcript) -> Iterator[NodeFinding]:
    answers = [answer for exchange in t.exchanges for answer in exchange.answers]
    if len(answers) > 20 and sum(answer.late for answer in answers) > 0.9 * len(answers):
        yield NodeFinding(
            "stamp",
            "the answers carry the stamp of an earlier state: they come after the next one",
            "copy header.stamp of the state that is being answered",
        )
        return
    for exchange in t.exchanges:
        for answer in exchange.answers:
            stamp_ns = answer.command.stamp_ns
            if stamp_ns == exchange.played.stamp_ns:
                continue
            if stamp_ns == 0:
                word = "no stamp (0)"
            elif stamp_ns >= _CLOCK_NS:
                word = f"the wall clock's stamp, {seconds(stamp_ns):.0f} s"
            else:
                word = f"the stamp t = {seconds(stamp_ns):.9g} s"
            yield NodeFinding(
                "stamp",
                f"the answer to {_at(exchange.played)} carries {word}",
                "copy header.stamp of the state into the command",
            )
            return


def _joint(t: Transcript) -> Iterator[NodeFinding]:
    for command in t.commands:
        if t.effort(command) is None:
            yield NodeFinding(
                "joint",
                f"the names are {quoted_names(command.name)}, with {len(command.effort)} values of effort",
                f"name = [{t.joint!r}], effort = [torque in N m]",
            )
            return


def _finite(t: Transcript) -> Iterator[NodeFinding]:
    for exchange in t.exchanges:
        for answer in exchange.answers:
            effort = t.effort(answer.command)
            if (
                effort is not None
                and not isfinite(effort)
                and exchange.played.phase in (MOTION, LARGE)
            ):
                where = "a large angle" if exchange.played.phase == LARGE else "an ordinary state"
                yield NodeFinding(
                    "finite",
                    f"at {_at(exchange.played)}, {where}, the torque is {effort}",
                    "limit it, and check it before it is published",
                )
                return


def _limits(t: Transcript) -> Iterator[NodeFinding]:
    if t.limit is None:
        return
    for exchange in t.exchanges:
        for answer in exchange.answers:
            effort = t.effort(answer.command)
            if effort is not None and isfinite(effort) and abs(effort) > t.limit:
                yield NodeFinding(
                    "limits",
                    f"at {_at(exchange.played)} the torque is {effort:.6g} N m, beyond +-{t.limit:g} N m",
                    "clamp the command",
                )
                return


def _rest(t: Transcript) -> Iterator[NodeFinding]:
    for effort in t.efforts(False, [REST]):
        if effort is not None and not isfinite(effort):
            yield NodeFinding(
                "rest",
                f"at angle, rate and error 0 the torque is {effort}",
                "divide by nothing that can be 0",
            )
            return


def _gap(t: Transcript) -> Iterator[NodeFinding]:
    after = [exchange for exchange in t.exchanges if exchange.played.phase == GAP]
    silent = [exchange for exchange in after if not exchange.answers]
    values = [value for value in t.efforts(False, [GAP]) if value is not None]
    if silent and any(exchange.answers for exchange in t.exchanges):
        yield NodeFinding(
            "gap",
            f"after 20 states were lost, {len(silent)} of {len(after)} states have no answer",
            "go on with the next state, whatever its stamp",
        )
    elif any(not isfinite(value) for value in values):
        yield NodeFinding(
            "gap", "after 20 states were lost the torque is not finite", "take dt from the stamps"
        )


def _repeat(t: Transcript) -> Iterator[NodeFinding]:
    before: Exchange | None = None
    for exchange in t.exchanges:
        if (
            exchange.played.phase == REPEAT
            and before is not None
            and exchange.answers
            and before.answers
        ):
            first, second = (t.effort(x.answers[0].command) for x in (before, exchange))
            if first is None or second is None or not (isfinite(first) and isfinite(second)):
                before = exchange
                continue
            if first != second:
                yield NodeFinding(
                    "repeat",
                    f"the same state a second time gives {second:.6g} N m, not {first:.6g} N m",
                    "ignore a state whose stamp is not newer: a link may deliver it twice",
                )
        before = exchange


def _silence(t: Transcript) -> Iterator[NodeFinding]:
    for exchange in t.exchanges:
        if exchange.played.phase != SILENCE:
            continue
        fresh = [a for a in exchange.answers if a.command.stamp_ns != exchange.played.stamp_ns]
        if fresh and len(exchange.answers) > 2:
            yield NodeFinding(
                "silence",
                f"{len(exchange.answers)} commands came in 0.5 s without a state, with stamps of no state",
                "command only in answer to a state: what is older than command_timeout must not act",
            )


def _reset(t: Transcript) -> Iterator[NodeFinding]:
    second = [exchange for exchange in t.exchanges if exchange.played.again]
    silent = [exchange for exchange in second if not exchange.answers]
    if silent and any(exchange.answers for exchange in t.exchanges):
        yield NodeFinding(
            "reset",
            f"after time went back to 0, {len(silent)} of {len(second)} states have no answer",
            "start anew when a stamp goes back: the simulator was restarted",
        )


def _bits(t: Transcript) -> Iterator[NodeFinding]:
    phases = (MOTION, REST, LARGE)
    played = [exchange.played for exchange in t.exchanges if exchange.played.again]
    pairs = zip(t.efforts(False, phases), t.efforts(True, phases), played, strict=False)
    for first, second, state in pairs:
        if first is None or second is None or not (isfinite(first) and isfinite(second)):
            continue
        if first != second:
            yield NodeFinding(
                "bits",
                f"the same states a second time, from t = 0 on, give {second!r} N m at {_at(state)}, "
                f"not {first!r} N m",
                "clear the memory when a stamp goes back, or offer ~/reset (std_srvs/Trigger); no clock, "
                "no randomness",
            )
            return


def _latency(t: Transcript) -> Iterator[NodeFinding]:
    times = t.latencies_s
    period_s = (t.exchanges[1].played.stamp_ns - t.exchanges[0].played.stamp_ns) / NANOSECONDS
    if times and times[len(times) // 2] > period_s:
        yield NodeFinding(
            "latency",
            f"half of the answers take longer than {1e3 * times[len(times) // 2]:.3g} ms, and a period is "
            f"{1e3 * period_s:.3g} ms",
            "answer in the callback, without a timer or a queue",
        )


CHECKS = (
    NodeCheck("answers", "every state has an answer", _answers),
    NodeCheck("once", "no state has two", _once),
    NodeCheck("stamp", "a command carries the stamp of the state that it answers", _stamp),
    NodeCheck("joint", "it names the joint, once, with an effort", _joint),
    NodeCheck("finite", "the torque is a finite number, also at large angles", _finite),
    NodeCheck("limits", "it is within the limit that --limit gives", _limits),
    NodeCheck("rest", "angle, rate and error 0 are an ordinary state", _rest),
    NodeCheck("gap", "it goes on after lost states", _gap),
    NodeCheck("repeat", "a state that comes twice changes nothing", _repeat),
    NodeCheck("silence", "without states it gives no new commands", _silence),
    NodeCheck("reset", "it goes on when time goes back to 0", _reset),
    NodeCheck("bits", "the same states give the same bits", _bits),
    NodeCheck("latency", "it answers within a period", _latency),
)
