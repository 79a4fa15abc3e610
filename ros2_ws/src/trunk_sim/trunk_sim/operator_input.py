"""An operator's pushes on the running trunk: one operator at a time, limited in size and duration.

Requests on `topics.OPERATOR_REQUEST` are checked here. Accepted ones are published on
`topics.OPERATOR_PUSH`, from which a run is recomputed. Pure.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from trunk_msgs_util.samples import JointSample
from trunk_msgs_util.text import quoted_names
from trunk_msgs_util.units import seconds

from .disturbances import Disturbance
from .inputs import RefusedError

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
