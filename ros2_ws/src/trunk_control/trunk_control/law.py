"""What a control law consists of: pure functions, parameters, a name and a label."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, get_type_hints

from .controller_config import ControllerConfig
from .limits import Limits


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
