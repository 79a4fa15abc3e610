"""What a control law consists of: pure functions, parameters, a name and a label; and what all laws share.

Every parameter that all controllers share is declared here, once, with what a law obeys whatever its gains:
derivative mode, filter, limits and anti-windup. The latter are a named tuple and a scalar function, which
CPython runs and numba compiles unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf
from typing import Any, NamedTuple, get_type_hints

from trunk_core.parameters.declarations import ParameterError, check_together, parameter
from trunk_core.parameters.shared import lockstep_parameter, rate_parameter
from trunk_core.units import nanoseconds

from .reference import ReferenceConfig

DERIVATIVE_ON_ERROR = 0  # D = (e_k - e_{k-1}) / h: the paper's eq. 13, kicks on reference steps
DERIVATIVE_ON_MEASUREMENT = 1  # D = -(y_k - y_{k-1}) / h
DERIVATIVE_FROM_RATE = 2  # D = -(measured rate): a gyro

ANTIWINDUP_NONE = 0
ANTIWINDUP_CONDITIONAL_INTEGRATION = 1
ANTIWINDUP_BACK_CALCULATION = 2


class Limits(NamedTuple):
    """What stays fixed while the gains change: modes, filter and limits.

    ``tracking_time_constant`` [s] is used by back-calculation, at least dt; 0 means sqrt(kd / ki)
    (= sqrt(Ti Td)), and kp / ki (= Ti) where kd is 0.
    """

    derivative: int = DERIVATIVE_ON_ERROR
    filter_time: float = 0.0  # s; 0: no filter
    u_min: float = -inf  # N m
    u_max: float = inf  # N m
    i_min: float = -inf  # N m, limits of the integral term
    i_max: float = inf  # N m
    antiwindup: int = ANTIWINDUP_NONE
    tracking_time_constant: float = 0.0  # s


def limited(effort: float, limits: Limits) -> float:
    """Return a command in N m, limited to [u_min, u_max]."""
    if effort > limits.u_max:
        return limits.u_max
    return limits.u_min if effort < limits.u_min else effort


DERIVATIVE_MODES = ("error", "measurement", "rate")
ANTIWINDUP_STRATEGIES = ("none", "conditional_integration", "back_calculation")


@dataclass(frozen=True)
class ControllerConfig(ReferenceConfig):
    """What every controller declares: its rate, joint, reference, derivative and limits."""

    update_rate: float = rate_parameter("Rate of the control law, measured by the states' stamps")
    lockstep: bool = lockstep_parameter(
        "Answer every state; between updates, repeat the last command"
    )
    derivative_mode: str = parameter(
        "derivative_mode",
        "rate",
        "The derivative of the error, of the measurement, or the measured rate (a gyro)",
        choices=DERIVATIVE_MODES,
    )
    derivative_filter_time: float = parameter(
        "derivative_filter_time",
        0.0,
        "Time constant of the derivative's filter; 0: none",
        unit="s",
        minimum=0.0,
        maximum=1e3,
    )
    u_clamp_max: float = parameter(
        "u_clamp_max", 100.0, "Upper limit of the command", unit="N m", unbounded=True
    )
    u_clamp_min: float = parameter(
        "u_clamp_min", -100.0, "Lower limit of the command", unit="N m", unbounded=True
    )
    i_clamp_max: float = parameter(
        "i_clamp_max",
        inf,
        "Upper limit of the integral term",
        unit="N m",
        minimum=0.0,
        unbounded=True,
    )
    i_clamp_min: float = parameter(
        "i_clamp_min",
        -inf,
        "Lower limit of the integral term",
        unit="N m",
        maximum=0.0,
        unbounded=True,
    )
    antiwindup_strategy: str = parameter(
        "antiwindup_strategy",
        "conditional_integration",
        "What the integral does while the command is limited",
        choices=ANTIWINDUP_STRATEGIES,
    )
    tracking_time_constant: float = parameter(
        "tracking_time_constant",
        0.0,
        "Time constant of back-calculation; 0: sqrt(kd / ki)",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    )
    active_times: tuple[float, ...] = parameter(
        "active.times",
        (),
        "Times at which the controller becomes active, inactive, active ...; empty: always active",
        unit="s",
        element=float,
        minimum=0.0,
        maximum=1e6,
        fixed=True,
    )
    handover_step: float = parameter(
        "handover.max_step",
        1.0,
        "After a takeover the command moves by at most this per update until it meets the law's",
        unit="N m",
        above=0.0,
        unbounded=True,
    )

    max_gap_periods: int = parameter(
        "gap.max_periods",
        100,
        "After more periods without a state, by the stamps, start afresh as after a reset; 0: never",
        minimum=0,
        maximum=1_000_000,
    )

    def __post_init__(self) -> None:
        if not self.u_clamp_max > self.u_clamp_min:
            raise ParameterError(
                "u_clamp_max",
                self.u_clamp_max,
                f"it must be greater than u_clamp_min ({self.u_clamp_min:g})",
            )
        super().__post_init__()
        check_together(self)
        if any(b <= a for a, b in pairwise(self.active_times)):
            raise ParameterError("active.times", self.active_times, "strictly ascending times")

    @property
    def active_times_ns(self) -> tuple[int, ...]:
        """`active_times` in ns."""
        return tuple(nanoseconds(t) for t in self.active_times)

    @property
    def hip(self) -> str | None:
        """The hip's joint, where the law uses its motion."""
        return None

    @property
    def hip_gains(self) -> tuple[float, float]:
        """kx, kv of a part ``-(kx q + kv q')`` of the command, q the hip's position; 0: no such part."""
        return 0.0, 0.0

    @property
    def uses_rate(self) -> bool:
        """True if the law uses the measured rate; a state without it is then not answered."""
        return self.derivative_mode == "rate" or self.hip is not None

    @property
    def damping_gain(self) -> float:
        """The largest gain on the rate, N m s/rad: it bounds the sampled loop's period."""
        return 0.0

    @property
    def constants(self) -> tuple[Any, ...]:
        """What the law's functions take besides the sample; each law defines it."""
        raise NotImplementedError

    @property
    def limits(self) -> Limits:
        """What stays fixed while gains change."""
        return Limits(
            DERIVATIVE_MODES.index(self.derivative_mode),
            self.derivative_filter_time,
            self.u_clamp_min,
            self.u_clamp_max,
            self.i_clamp_min,
            self.i_clamp_max,
            ANTIWINDUP_STRATEGIES.index(self.antiwindup_strategy),
            self.tracking_time_constant,
        )


class Hip(NamedTuple):
    """The hip as measured: m, m/s."""

    position: float = 0.0
    velocity: float = 0.0


class Sample(NamedTuple):
    """A law's inputs at one update."""

    reference: float  # rad
    measurement: float  # rad
    rate: float  # rad/s, measured
    dt: float  # s since the last update
    hip: Hip = Hip()  # as measured, for laws that use the hip


# Named tuples of each law's own.
LawMemory = Any
LawTerms = Any
Constants = tuple[Any, ...]
Update = Callable[[LawMemory, Sample, Constants, Limits], tuple[LawMemory, LawTerms]]
# (memory after a reset, angle of the last state seen [rad], sample, acting torque [N m], constants, limits)
BumplessTransfer = Callable[[LawMemory, float, Sample, float, Constants, Limits], LawMemory]
# (memory, its last sample, constants before, constants after)
Reconfigure = Callable[[LawMemory, Sample, Constants, Constants], LawMemory]

# The last fields of every law's terms, in this order.
OUTCOME = ("unsaturated", "effort", "held")


@dataclass(frozen=True)
class Lookup:
    """For a law with tables: the part it needs while its inputs stay in one cell.

    Vector code cannot look up tables quickly, but a lane seldom leaves its cell. ``update`` gives the
    same bits with ``near(cell, constants)`` as with all constants.
    """

    inputs: Callable[[LawMemory, Sample, Limits], tuple[float, float]]
    cell: Callable[[float, float, Constants], Any]  # from the inputs
    near: Callable[[Any, Constants], Constants]
    # A cell is a named tuple of floats. The first four are the lower and the upper bound of either input,
    # the upper one excluded.
    kind: type[Any]


def from_scratch(
    initial: LawMemory,
    seen: float,
    sample: Sample,
    effort: float,
    constants: Constants,
    limits: Limits,
) -> LawMemory:
    """Return the memory of a law that begins as after a reset; `transfer_limits` bounds its steps."""
    return initial


def unchanged(memory: LawMemory, sample: Sample, before: Constants, after: Constants) -> LawMemory:
    """Return the memory as it is: the command may jump where constants change."""
    return memory


@dataclass(frozen=True, eq=False)
class Law:
    """A control law. Its functions are pure: CPython runs them and numba compiles them unchanged.

    ``update(memory, sample, constants, limits)`` returns the next memory and the terms of one update.
    ``constants`` is the configuration's property of that name; ``limits`` has the limits of the command,
    narrowed during a bumpless transfer, and the configuration's derivative mode and anti-windup.

    The memory is a named tuple with a field ``effort``, the last command in N m. The terms are a named
    tuple of floats that ends with ``unsaturated`` and ``effort`` [N m], and ``held``: True if the sample was
    not usable, so that memory and command stay. Raises TypeError for anything else.
    """

    name: str  # also of the node, its executable and its section of parameters
    label: str  # in tables and plots
    config: type[ControllerConfig]
    update: Update
    memory: LawMemory  # after a reset
    terms: type[Any]
    units: Mapping[str, str] = field(default_factory=dict)  # of the terms; empty for a ratio
    transfer: BumplessTransfer = from_scratch  # of a moving plant, without a jump of the command
    reconfigure: Reconfigure = unchanged  # to other constants, without a jump
    describe: Callable[[Any], str] | None = None  # what to add to the label about a configuration
    lookup: Lookup | None = None
    plant: str = ""  # whose model it contains; empty: any plant's

    def __post_init__(self) -> None:
        if "effort" not in getattr(self.memory, "_fields", ()):
            raise TypeError(
                f"memory = {self.memory!r}: a named tuple with a field 'effort' is needed, "
                "the last command in N m"
            )
        fields = getattr(self.terms, "_fields", ())
        if fields[-3:] != OUTCOME:
            raise TypeError(
                f"the fields of terms are {', '.join(fields) or 'none'}: a named tuple whose last "
                f"fields are {', '.join(OUTCOME)} is needed"
            )
        hints = get_type_hints(self.terms)
        wrong = [name for name in fields if hints[name] is not (bool if name == "held" else float)]
        if wrong:
            raise TypeError(
                f"terms.{wrong[0]} is not a float: all terms are floats, except held, a bool"
            )
        unknown = [name for name in self.units if name not in fields]
        if unknown:
            raise TypeError(f"units names {unknown[0]!r}, which is not one of {', '.join(fields)}")

    @property
    def no_terms(self) -> LawTerms:
        """Terms of zeros, not held."""
        fields = self.terms._fields
        return self.terms(**dict.fromkeys(fields[:-1], 0.0), held=False)

    @property
    def record_names(self) -> tuple[str, ...]:
        """The names of a ``~/state`` record, in order."""
        return ("reference", "measurement", *self.terms._fields[:-1])
