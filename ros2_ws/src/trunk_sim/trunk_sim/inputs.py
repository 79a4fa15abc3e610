"""What acts on the plant: commands, disturbances and an operator's pushes, checked as they arrive. Pure.

Commands and disturbances are queued, and recorded. One operator at a time pushes the running trunk, limited
in size and duration: requests on `topics.OPERATOR_REQUEST` are checked here, and accepted ones are published
on `topics.OPERATOR_PUSH`, from which a run is recomputed.
"""

from __future__ import annotations

from collections import deque
from math import isfinite
from typing import NamedTuple

from trunk_core.errors import TrunkError
from trunk_core.samples import JointSample, has_doubled
from trunk_core.text import quoted_names
from trunk_core.topics import INPUT_NAMES
from trunk_core.units import seconds
from trunk_msgs_util.source import frame_of_inputs

from .disturbances import Disturbance

_NONE_NS = -1
# How far ahead a disturbance may arrive; one stamped later than this would block all that follow.
_AHEAD_NS = 1_000_000_000
_DEPTH = 5000


class RefusedError(TrunkError):
    """The message is ignored; the text is what it is counted as, ``why`` its fault and the remedy."""

    def __init__(self, kind: str, why: str = "") -> None:
        super().__init__(kind)
        self.why = why


def effort_of(command: JointSample, joint: str) -> float:
    """Return a command's effort on a joint in N m. Raises RefusedError."""
    names = quoted_names(command.name)
    if joint not in command.name or has_doubled(command.name):
        raise RefusedError(
            "commands without the joint",
            f"their names are {names}: {joint!r} must be there, once, and no other name twice",
        )
    place = command.name.index(joint)
    if place >= len(command.effort):
        raise RefusedError(
            "commands without an effort",
            f"{len(command.effort)} values of effort for the names {names}: one for each is needed, in N m",
        )
    effort = command.effort[place]
    if not isfinite(effort):
        raise RefusedError("commands not finite", f"the effort of {joint!r} is {effort}, N m")
    return effort


def disturbance_of(sample: JointSample, joints: tuple[str, ...]) -> Disturbance:
    """Return the disturbance in a message, as `disturbance_sample` makes it. Raises RefusedError."""
    if sample.name != joints or not len(sample.effort) == len(sample.position) == 2:
        raise RefusedError(
            "disturbances malformed",
            f"the names must be {quoted_names(joints)}, with two values of effort and two of position; "
            f"they are {quoted_names(sample.name)}, with {len(sample.effort)} and {len(sample.position)}",
        )
    values = (*sample.effort, *sample.position)
    if not all(map(isfinite, values)):
        raise RefusedError("disturbances not finite", f"the values are {values}")
    return Disturbance(*values)


class Command(NamedTuple):
    """A command that the plant has taken: the state that it answers, its torque in N m, and its sender."""

    stamp_ns: int
    effort: float
    source: str


class Disturbed(NamedTuple):
    """A disturbance that the plant has taken: since when it acts, what it is, and its sender."""

    stamp_ns: int
    disturbance: Disturbance
    source: str


NO_COMMAND = Command(_NONE_NS, 0.0, "")
UNDISTURBED = Disturbed(_NONE_NS, Disturbance(), "")


def inputs_row(stamp_ns: int, command: Command, disturbed: Disturbed) -> JointSample:
    """Return the inputs of the step from the state with this stamp, each value with its age in ns.

    The age is -1 where nothing is in force. It is a double, exact below 104 days.
    """
    age, since = (
        -1.0 if source.stamp_ns < 0 else float(stamp_ns - source.stamp_ns)
        for source in (command, disturbed)
    )
    return JointSample(
        stamp_ns,
        INPUT_NAMES,
        (command.effort, *disturbed.disturbance),
        (age, since, since, since, since),
    )


def inputs_frame(simulator: str, command: Command, disturbed: Disturbed) -> str:
    """Return the frame of a row: the sources of the row, the command and the disturbance."""
    return frame_of_inputs(simulator, command.source, disturbed.source)


class DisturbanceFeed:
    """Keeps each disturbance until its time comes."""

    def __init__(self, period_ns: int) -> None:
        self._ahead_ns = max(period_ns, _AHEAD_NS)
        self._queue: deque[Disturbed] = deque(maxlen=_DEPTH)
        self._queued_until_ns = -1
        self._latest = UNDISTURBED
        self.in_use = UNDISTURBED

    def __bool__(self) -> bool:
        """Return True while a disturbance is waiting for its time."""
        return bool(self._queue)

    @property
    def disturbance(self) -> Disturbance:
        """What acts."""
        return self.in_use.disturbance

    def take(self, stamp_ns: int, disturbance: Disturbance, now_ns: int, source: str = "") -> None:
        """Queue what acts from a stamp on. Raises RefusedError for one out of order or too far ahead."""
        if stamp_ns <= self._queued_until_ns:
            raise RefusedError(
                "disturbances out of order",
                f"t = {seconds(stamp_ns):g} s comes after t = {seconds(self._queued_until_ns):g} s: "
                "stamps must ascend",
            )
        if stamp_ns - now_ns > self._ahead_ns:
            raise RefusedError(
                f"disturbances more than {seconds(self._ahead_ns):g} s ahead",
                f"t = {seconds(stamp_ns):.9g} s, while the state is at t = {seconds(now_ns):g} s: "
                "stamp them in simulated time",
            )
        self._queued_until_ns = stamp_ns
        self._queue.append(Disturbed(stamp_ns, disturbance, source))

    def advance(self, now_ns: int, timeout_ns: int | None) -> bool:
        """Set ``in_use`` to what acts at a stamp; return True if the latest disturbance is too old.

        Its sender is then taken as gone; a pulse must not last forever. Without a timeout nothing is too old.
        """
        while self._queue and self._queue[0].stamp_ns <= now_ns:
            self._latest = self._queue.popleft()
        stale = timeout_ns is not None and 0 <= self._latest.stamp_ns < now_ns - timeout_ns
        self.in_use = UNDISTURBED if stale else self._latest
        return stale


_LONGEST_NAME = 64


class Applied(NamedTuple):
    """What the operator applies over a step."""

    hip_force: float = 0.0  # N
    trunk_torque: float = 0.0  # N m


NOTHING = Applied()


class OperatorLimits(NamedTuple):
    """How hard an operator may push, and for how long without a new request."""

    hip_force: float  # N
    trunk_torque: float  # N m
    timeout_ns: int

    def apply(self, request: Applied, since_ns: int, now_ns: int) -> Applied:
        """Return the effect at ``now_ns`` of a request taken at ``since_ns``: nothing after the timeout."""
        return request if now_ns - since_ns <= self.timeout_ns else NOTHING

    def clip(self, request: Applied) -> Applied:
        """Return the request with each value clamped to +- its limit."""
        return Applied(
            max(-self.hip_force, min(request.hip_force, self.hip_force)),
            max(-self.trunk_torque, min(request.trunk_torque, self.trunk_torque)),
        )


def with_operator(disturbance: Disturbance, applied: Applied) -> Disturbance:
    """Return the disturbance with the operator's force and torque added; as it is where those are 0."""
    if applied.hip_force == 0.0 and applied.trunk_torque == 0.0:
        return disturbance
    return Disturbance(
        disturbance.hip_force + applied.hip_force,
        disturbance.trunk_torque + applied.trunk_torque,
        disturbance.hip_offset,
        disturbance.trunk_offset,
    )


def request_of(sample: JointSample, joints: tuple[str, ...]) -> Applied:
    """Return a message's request: an effort for each joint. Raises RefusedError."""
    if sample.name != joints or len(sample.effort) != 2 or sample.position or sample.velocity:
        raise RefusedError(
            "requests of the operator malformed",
            f"the names must be {quoted_names(joints)}, with two values of effort alone; "
            f"they are {quoted_names(sample.name)}",
        )
    if not all(map(isfinite, sample.effort)):
        raise RefusedError(
            "requests of the operator not finite", f"the values are {sample.effort}, N and N m"
        )
    return Applied(*sample.effort)


class Operator:
    """Takes requests; the first to ask is the operator until silent for longer than the timeout."""

    def __init__(self, limits: OperatorLimits) -> None:
        self._limits = limits
        self._name = ""
        self._stamp_ns = self._since_ns = -1
        self._request = NOTHING
        self._new = False

    def take(self, name: str, stamp_ns: int, request: Applied, now_ns: int) -> None:
        """Take a request made on seeing the state with this stamp.

        Raises RefusedError for one without a name, from another operator, from the future, or older than
        the timeout or the last one.
        """
        if not name or len(name) > _LONGEST_NAME:
            raise RefusedError(
                "requests of an operator without a name",
                f"header.frame_id must name the operator, in at most {_LONGEST_NAME} characters",
            )
        if stamp_ns > now_ns or stamp_ns < now_ns - self._limits.timeout_ns:
            raise RefusedError(
                "requests of the operator out of time",
                f"t = {seconds(stamp_ns):.9g} s, while the state is at t = {seconds(now_ns):g} s: copy "
                "header.stamp of the state that was seen, or leave it empty",
            )
        silent = self._since_ns < 0 or now_ns - self._since_ns > self._limits.timeout_ns
        if self._name not in ("", name) and not silent:
            raise RefusedError(
                "requests of a second operator",
                f"{self._name[:40]!r} is the operator; {name[:40]!r} has to wait",
            )
        if name == self._name and stamp_ns < self._stamp_ns:
            raise RefusedError(
                "requests of the operator out of order",
                f"t = {seconds(stamp_ns):g} s comes after t = {seconds(self._stamp_ns):g} s",
            )
        self._name, self._stamp_ns, self._since_ns = name, stamp_ns, now_ns
        self._request, self._new = self._limits.clip(request), True

    def new_request(self) -> Applied | None:
        """Return the last accepted request if it is new since the last call."""
        new, self._new = self._new, False
        return self._request if new else None

    def applied(self, now_ns: int) -> Applied:
        """Return the push on the step from this stamp on; nothing if the operator has gone silent."""
        return self._limits.apply(self._request, self._since_ns, now_ns)
