"""A controller, sample by sample: what the nodes, the offline run and a replay all drive.

A controller has no clock of its own: it acts on the stamps of the states that it is given, at most
at its ``update_rate``, and holds its command in between. One that becomes active while the plant moves
takes over without a bump: its integral is set so that its first command is the torque that acts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from trunk_msgs_util.units import seconds

from .computed_torque import Hip
from .config import FuzzyPidConfig, PidConfig
from .controller_config import ControllerConfig
from .fuzzy_pid import fuzzy_pid_update, inferred_gains
from .pid import Gains, PidLaw, PidState, Terms, limited, pid_update, retune
from .reference import reference_at


class Answer(NamedTuple):
    """What a controller makes of one state."""

    effort: float  # N m
    fresh: bool  # False: the command is held, no update was due
    reference: float  # rad
    terms: Terms | None  # of the update; None where the command is held
    held: bool = False  # an update was due, and the law gave no finite number


class Seen(NamedTuple):
    """The last state before a controller became active."""

    stamp_ns: int
    position: float  # rad


_STILL = Hip()


def handover_law(law: PidLaw, effort: float, step: float) -> PidLaw:
    """Return the law with its limits drawn in to ``effort`` +- ``step`` [N m], never beyond its own."""
    return law._replace(u_min=limited(effort - step, law), u_max=limited(effort + step, law))


def hip_index(config: ControllerConfig, joints: Sequence[str]) -> int | None:
    """Return the place of the hip among the joints; None for a law that does not use it.

    Raises ValueError where the joint is not there.
    """
    return None if config.hip is None else joints.index(config.hip)


def hip_seen(index: int | None, position: Sequence[float], velocity: Sequence[float]) -> Hip:
    """Return the hip's motion from a state's values."""
    return _STILL if index is None else Hip(position[index], velocity[index])


class Controller(ABC):
    """The shell that all laws share: due instants, time steps, the reference, reset, retuning, handover."""

    config: ControllerConfig
    state: PidState

    def __init__(self, config: ControllerConfig) -> None:
        self.active = True
        self._last_ns: int | None = None
        self._takes_over: Seen | None = None  # until the first update after it became active
        self._moving_from: float | None = None  # N m, until the command has met the law's
        self._configure(config)
        self.reset()

    def _configure(self, config: ControllerConfig) -> None:
        self.config = config
        self._law = config.law
        self._profile = config.reference
        self._period_ns = config.period_ns
        # Periods are rounded to whole ns: n of the plant's may fall short of one of ours by some ns.
        self._due_after_ns = config.period_ns - config.period_ns // 1000

    @abstractmethod
    def _update(
        self, reference: float, measurement: float, rate: float, hip: Hip, dt: float
    ) -> tuple[PidState, Terms]:
        """Return the next state and the terms of one update of the law."""

    @abstractmethod
    def _gains(self) -> Gains:
        """Return the gains at the last sample."""

    def due(self, stamp_ns: int) -> bool:
        """Return True where a state with this stamp calls for an update."""
        return self._last_ns is None or stamp_ns - self._last_ns >= self._due_after_ns

    def update(
        self,
        stamp_ns: int,
        position: float,
        velocity: float,
        reference: float | None = None,
        hip: Hip = _STILL,
        effort: float = 0.0,
    ) -> Answer:
        """Return the answer to a state: angle in rad, rate in rad/s, at a stamp in ns.

        ``reference`` [rad] replaces the configured profile; ``hip`` is for laws whose configuration
        names the hip's joint; ``effort`` [N m] is the torque that acts, from which a controller goes on
        that takes over. A stamp that runs back resets the controller: time began anew.
        """
        last_ns = self._last_ns
        if last_ns is not None and stamp_ns < last_ns:
            self.reset()
            last_ns = None
        if reference is None:
            reference = reference_at(stamp_ns, self._profile)
        if not self.due(stamp_ns):
            return Answer(self.state.effort, False, reference, None)
        dt = seconds(self._period_ns if last_ns is None else stamp_ns - last_ns)
        if self._takes_over is not None:
            if stamp_ns > self._takes_over.stamp_ns:
                dt = seconds(stamp_ns - self._takes_over.stamp_ns)
            self._take_over(self._takes_over, reference, position, velocity, hip, dt, effort)
        if self._moving_from is not None:
            self._law = handover_law(self.config.law, self._moving_from, self.config.handover_step)
        state, terms = self._update(reference, position, velocity, hip, dt)
        if state is self.state:  # held: not a finite sample; dt goes on from the last that was
            return Answer(terms.effort, False, reference, None, held=True)
        self.state = state
        self._last_ns = stamp_ns
        self._takes_over = None
        if self._moving_from is not None:
            self._move_on(terms)
        return Answer(terms.effort, True, reference, terms)

    def _take_over(
        self,
        seen: Seen,
        reference: float,
        position: float,
        rate: float,
        hip: Hip,
        dt: float,
        effort: float,
    ) -> None:
        """Set the integral so that the command goes on from ``effort``: I = (u - u|I=0) / ki.

        The last state before gives the derivative its past; a jump of the reference is not in it. What
        the integral cannot take up (ki = 0, its limits) the command makes up for in bounded steps.
        """
        effort = limited(effort, self.config.law)
        error = reference - seen.position
        self.state = PidState(0.0, error, seen.position, 0.0, effort, True)
        _, terms = self._update(reference, position, rate, hip, dt)
        if terms.ki > 0.0:
            integral = (effort - terms.unsaturated) / terms.ki
            if isfinite(integral):
                self.state = self.state._replace(integral=integral)
        self._moving_from = effort

    def _move_on(self, terms: Terms) -> None:
        """Lift the handover's limits once the command is the one that the law's own limits would leave."""
        law = self.config.law
        if terms.effort == limited(terms.unsaturated, law):
            self._moving_from = None
            self._law = law
        else:
            self._moving_from = terms.effort

    @property
    def takes_over(self) -> bool:
        """True before the first update after it became active while the plant moved."""
        return self._takes_over is not None

    def activate(self, seen: Seen | None = None) -> None:
        """Begin to answer states, afresh, or from the torque that acts where a state was ``seen`` before."""
        if not self.active:
            self.reset()
            self.active = True
            self._takes_over = seen

    def deactivate(self) -> None:
        """Leave the plant to another: ``update`` is not called until `activate`."""
        self.active = False

    def reset(self) -> None:
        """Forget the past: the integral, the last sample and the last stamp."""
        self._law = self.config.law
        self.state = PidState(effort=limited(0.0, self._law))
        self._last_ns = None
        self._takes_over = self._moving_from = None

    def retune(self, config: ControllerConfig) -> None:
        """Take a new configuration between two samples; the integral is rescaled: no jump in the command.

        A command that is held is within the new limits at once.
        """
        old = self._gains()
        self._configure(config)
        state = retune(self.state, old, self._gains())
        self.state = state._replace(effort=limited(state.effort, self._law))


class PidController(Controller):
    """PID with constant gains."""

    config: PidConfig

    def _configure(self, config: ControllerConfig) -> None:
        super()._configure(config)
        self._pid_gains = self.config.gains

    def _gains(self) -> Gains:
        return self._pid_gains

    def _update(
        self, reference: float, measurement: float, rate: float, hip: Hip, dt: float
    ) -> tuple[PidState, Terms]:
        return pid_update(self.state, reference, measurement, rate, dt, self._pid_gains, self._law)


class FuzzyPidController(Controller):
    """PID with gains inferred at each sample."""

    config: FuzzyPidConfig

    def _configure(self, config: ControllerConfig) -> None:
        super()._configure(config)
        self._rules = self.config.rules
        self._box = self.config.box

    def _gains(self) -> Gains:
        return inferred_gains(self.state.error, self.state.derivative, self._rules, self._box)[0]

    def _update(
        self, reference: float, measurement: float, rate: float, hip: Hip, dt: float
    ) -> tuple[PidState, Terms]:
        return fuzzy_pid_update(
            self.state, reference, measurement, rate, dt, self._rules, self._box, self._law
        )
