"""Does a recording follow from itself? Structure first, then every command and state computed again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise, takewhile

from trunk_msgs_util import provenance, topics
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.recording.reader import Recording
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS
from ..plans.timeline import DEACTIVATED
from .bits import ulps
from .replay import (
    ACTIVE_CONTROLLERS,
    Difference,
    Messages,
    config_of,
    in_turn,
    replay_controllers,
    replay_disturbance,
    replay_plant,
)

VERIFIED, DIVERGES, UNJUDGED = 0, 1, 2
# What decides the bits of sin, cos and exp, and of the noise.
_ARITHMETIC = ("libm", "machine", "numpy")


@dataclass
class Part:
    """One kind of recomputation: how many steps were checked and what differed."""

    name: str
    steps: int = 0
    wrong_steps: int = 0
    first: list[Difference] = field(default_factory=list)

    def check(self, replay: Iterable[tuple[int, list[Difference]]]) -> None:
        """Take in all steps of a replay."""
        for _, found in replay:
            self.take(found)

    def take(self, found: list[Difference]) -> None:
        """Take in one step."""
        self.steps += 1
        if found:
            self.wrong_steps += 1
            self.first = self.first or found


@dataclass
class Verdict:
    """What `verify` found. ``obstacles``: why the run cannot be judged as a whole.

    ``altered``: topics whose content is not what the recorder wrote, whether or not that decides a bit.
    """

    parts: list[Part] = field(default_factory=list)
    altered: list[str] = field(default_factory=list)
    obstacles: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def exit_code(self) -> int:
        """0 verified, 1 something diverges, 2 nothing diverges but the run cannot be judged."""
        if self.altered or any(part.wrong_steps for part in self.parts):
            return DIVERGES
        return UNJUDGED if self.obstacles or not self.parts else VERIFIED

    @property
    def word(self) -> str:
        """The verdict in a word or two."""
        return ("verified", "diverges", "cannot be judged")[self.exit_code]


def describe(difference: Difference) -> str:
    """Return a difference as one line: where, both values, how far apart."""
    if difference.field == "missing":
        return f"t = {seconds(difference.stamp_ns):g} s: {difference.topic}: no message with this stamp"
    if difference.field == ACTIVE_CONTROLLERS:
        count = f"{difference.recorded:.0f} controllers are active by the run's events"
        return f"t = {seconds(difference.stamp_ns):g} s: {count}, 1 gave a command"
    distance = ulps(difference.recorded, difference.computed)
    return (
        f"t = {seconds(difference.stamp_ns):g} s: {difference.topic}: {difference.field}: "
        f"recorded {difference.recorded!r}, computed {difference.computed!r}"
        + ("" if distance is None else f", {distance} ULP apart")
    )


def verify(recording: Recording) -> Verdict:
    """Return the verdict on a recording; damage and gaps are obstacles, never passed over."""
    verdict = Verdict()
    verdict.obstacles += recording.warnings
    verdict.altered = recording.altered_topics()
    if recording.end is None:
        verdict.obstacles.append("no end marker: the recorder did not finish this file")
    mode = recording.provenance.get("mode", "")
    if not mode:
        verdict.obstacles.append("no provenance: the mode of the run is not known")
    controllers = recording.controllers
    if not controllers or not set(controllers) <= set(CONTROLLERS):
        found = ", ".join(controllers) or "none"
        verdict.obstacles.append(f"no known controller's state is recorded (found: {found})")
        return verdict
    nodes = {*controllers, "simulator"} | (
        {"disturbance"} if _count(recording, topics.DISTURBANCE) else set()
    )
    missing = nodes - {name.rsplit("/", 1)[-1] for name in recording.parameters()}
    if missing:
        verdict.obstacles.append(f"no parameters recorded of {', '.join(sorted(missing))}")
        return verdict
    exact_time = mode in ("lockstep", "offline")
    try:
        period_ns = config_of(recording, "simulator").period_ns
        verdict.obstacles += _gaps(recording, period_ns, exact_time)
        until_ns = _recorded_until_ns(recording)
        if until_ns is not None:
            verdict.obstacles.append(
                f"the recorder was inactive from t = {seconds(until_ns):g} s: what came after is not judged"
            )
        _recompute(recording, controllers, exact_time, verdict, until_ns)
    except ParameterError as error:
        verdict.obstacles.append(f"recorded parameters cannot be used: {error}")
    if not exact_time:
        verdict.notes.append(
            "real-time run: its states depend on the wall clock and are not recomputed"
        )
    verdict.notes += _platform(recording)
    return verdict


def _recorded_until_ns(recording: Recording) -> int | None:
    """Return the last stamp before the recorder became inactive; None where the run had ended by then."""
    node = recording.topic("recorder")
    turns = [e for e in recording.events() if e.node == node and e.message == DEACTIVATED]
    stamps = Messages(recording, topics.EFFORT_COMMAND).stamps
    if turns and turns[0].stamp_ns < max(stamps, default=0):
        return turns[0].stamp_ns
    return None


def _recompute(
    recording: Recording,
    controllers: list[str],
    exact: bool,
    verdict: Verdict,
    until_ns: int | None,
) -> None:
    def judged(stamp_ns: int) -> bool:
        return until_ns is None or stamp_ns <= until_ns

    parts = {name: Part(f"commands of {name}") for name in controllers}
    nobodys = Part("commands without one active controller")
    for name, stamp_ns, found in replay_controllers(recording, controllers):
        if not judged(stamp_ns):
            break
        parts.get(name, nobodys).take(found)
    verdict.parts += [*parts.values(), *([nobodys] if nobodys.steps else [])]
    replays = {}
    if _count(recording, topics.DISTURBANCE):
        replays["disturbances"] = replay_disturbance(recording)
    if exact:
        replays["states of the plant"] = replay_plant(recording)
    for name, replay in replays.items():
        part = Part(name)
        part.check(takewhile(lambda step: judged(step[0]), replay))
        verdict.parts.append(part)


def _count(recording: Recording, relative: str) -> int:
    topic = recording.topics.get(recording.topic(relative))
    return topic.count if topic else 0


def _gaps(recording: Recording, period_ns: int, exact: bool) -> list[str]:
    """Return what is wrong with the stamps of each topic, and of the topics against one another."""
    found = []
    truth = Messages(recording, topics.GROUND_TRUTH).stamps
    wanted = set(truth)
    for relative in (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND):
        stamps = Messages(recording, relative).stamps
        if relative == topics.EFFORT_COMMAND:
            stamps = list(in_turn(stamps, recording.controllers))
        found += _disorder(relative, stamps)
        if relative == topics.GROUND_TRUTH:
            absent = sorted(set(range(0, (max(stamps, default=0)) + 1, period_ns)) - set(stamps))
        elif exact or relative == topics.JOINT_STATES:
            absent = sorted(wanted - set(stamps))
        else:
            absent = []
        if absent:
            found.append(
                f"{relative}: {len(absent)} steps missing, the first at t = {seconds(absent[0]):g} s"
            )
    if _count(recording, topics.DISTURBANCE):
        stamps = Messages(recording, topics.DISTURBANCE).stamps
        found += _disorder(topics.DISTURBANCE, stamps)
        absent = sorted(wanted - set(stamps)) if exact else []
        if absent:
            found.append(
                f"{topics.DISTURBANCE}: {len(absent)} steps missing, "
                f"the first at t = {seconds(absent[0]):g} s"
            )
    if not truth:
        found.append(f"{topics.GROUND_TRUTH}: no messages")
    return found


def _disorder(relative: str, stamps: list[int]) -> list[str]:
    for before, after in pairwise(stamps):
        if after == before:
            return [f"{relative}: the stamp t = {seconds(after):g} s stands twice"]
        if after < before:
            there_and_back = f"from t = {seconds(before):g} s to t = {seconds(after):g} s"
            return [f"{relative}: stamps run back, {there_and_back}"]
    return []


def _platform(recording: Recording) -> list[str]:
    here = provenance.gather()
    return [
        f"recorded with {key} {recording.provenance[key]}, here {here[key]}: last bits may differ"
        for key in _ARITHMETIC
        if key in recording.provenance and recording.provenance[key] != here.get(key)
    ]
