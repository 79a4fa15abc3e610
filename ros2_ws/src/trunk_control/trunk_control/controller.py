"""A controller, updated state by state; the nodes, the offline run and a verification all use it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from trunk_core.samples import has_doubled
from trunk_core.units import LAST_STAMP_NS

from .decide import (
    ControllerState,
    Output,
    Reading,
    Seen,
    Settings,
    activated,
    deactivated,
    decide,
    followed,
    initial_state,
    reconfigured,
)
from .law import ControllerConfig, Hip, Law, LawMemory, limited
from .laws import law_of

_STILL = Hip()


class Places(NamedTuple):
    """Indices into a joint state's arrays."""

    joint: int
    hip: int | None  # None: the law does not use the hip

    @property
    def last(self) -> int:
        """The larger index: arrays must be longer than this."""
        return max(self.joint, -1 if self.hip is None else self.hip)


class JointPlaces:
    """Finds the joints by name in each message and ignores all others.

    On a robot several publishers may share a topic, each with its own joints in its own order: the last
    list of names is remembered only if it contained every joint needed.
    """

    def __init__(self, joint: str, hip: str | None = None) -> None:
        self._joint = joint
        self._hip = hip
        self._names: Sequence[str] | None = None
        self._places = Places(0, None)

    def __call__(self, names: Sequence[str]) -> Places | None:
        """Return the joints' indices, or None if one of them is missing, or a name appears twice."""
        if names != self._names:
            if has_doubled(names):
                return None
            try:
                places = Places(
                    names.index(self._joint), None if self._hip is None else names.index(self._hip)
                )
            except ValueError:
                return None
            self._names, self._places = names, places
        return self._places


def hip_index(config: ControllerConfig, joints: Sequence[str]) -> int | None:
    """Return the hip's index among the joints; None for a law that does not use it.

    Raises ValueError if the joint is missing.
    """
    return None if config.hip is None else joints.index(config.hip)


def hip_seen(index: int | None, position: Sequence[float], velocity: Sequence[float]) -> Hip:
    """Return the hip's motion from a state's values."""
    return _STILL if index is None else Hip(position[index], velocity[index])


def settings_of(config: ControllerConfig, law: Law | None = None) -> Settings:
    """Return the `Settings` of a law, by default the registered one, for this configuration."""
    law, limits = law or law_of(config), config.limits
    return Settings(
        limits,
        law.memory._replace(effort=limited(law.memory.effort, limits)),
        law.no_terms,
        config.reference,
        config.active_times_ns,
        config.period_ns,
        config.handover_step,
        config.max_gap_periods * config.period_ns if config.max_gap_periods else LAST_STAMP_NS,
    )


class Controller:
    """Keeps what `decide` needs from one state to the next."""

    def __init__(self, config: ControllerConfig, law: Law | None = None) -> None:
        """Start active, unless turns are scheduled; the law is by default the registered one."""
        self.law = law or law_of(config)
        self._configure(config)
        active = not config.active_times
        self.state: ControllerState = initial_state(active, Seen(), self.settings.initial)

    def _configure(self, config: ControllerConfig) -> None:
        self.config = config
        self.settings = settings_of(config, self.law)
        self.constants = config.constants

    @property
    def active(self) -> bool:
        """True while it is this controller's turn."""
        return self.state.pace.active

    @property
    def memory(self) -> LawMemory:
        """The law's own memory."""
        return self.state.memory

    def decide(self, reading: Reading) -> Output:
        """Return the answer to a state."""
        self.state, output = decide(
            self.state,
            reading,
            self.settings,
            self.constants,
            self.law.update,
            self.law.transfer,
        )
        return output

    def update(
        self,
        stamp_ns: int,
        position: float,
        velocity: float,
        reference: float | None = None,
        hip: Hip = _STILL,
        effort: float = 0.0,
    ) -> Output:
        """Return the answer to a state: angle in rad, rate in rad/s, at a stamp in ns.

        ``reference`` [rad]: the latest one received by topic, or None; ``effort`` [N m]: the torque
        that acts.
        """
        received = () if reference is None else (True, reference)
        return self.decide(Reading(stamp_ns, position, velocity, hip, effort, *received))

    def see(self, stamp_ns: int, position: float) -> None:
        """Note a state that needs no answer."""
        self.state = followed(self.state, stamp_ns, position)

    def activate(self) -> None:
        """Start answering: from scratch, or, if a state was seen before, from the torque that acts."""
        self.state = activated(self.state, self.settings.initial)

    def deactivate(self) -> None:
        """Leave the plant to another controller."""
        self.state = deactivated(self.state)

    def reset(self) -> None:
        """Forget the past: the integral, the last sample and the last stamp."""
        self.state = initial_state(self.active, self.state.pace.seen, self.settings.initial)

    def forget(self) -> None:
        """Start over as if new: no state seen, active or not as the configuration says."""
        self.state = initial_state(not self.config.active_times, Seen(), self.settings.initial)

    def reconfigure(self, config: ControllerConfig) -> None:
        """Change the configuration between two samples; the command does not jump.

        A held command obeys the new limits at once.
        """
        old = self.constants
        self._configure(config)
        self.state = reconfigured(self.state, self.law, old, self.constants, self.settings.limits)
