"""A registered law with its parameters as C: what is translated, and the texts that it makes."""

from __future__ import annotations

import hashlib
import json
import random
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from trunk_control.controller import Controller, settings_of
from trunk_control.controller_config import ControllerConfig
from trunk_control.decide import (
    Reading,
    Seen,
    activated,
    deactivated,
    decide,
    initial_state,
    reconfigured,
)
from trunk_control.law import Hip, Law, LawMemory, Sample
from trunk_control.laws import package_of
from trunk_control.limits import Limits, limited
from trunk_msgs_util.parameters.declarations import values_of
from trunk_msgs_util.units import seconds

from .leaves import Leaf, leaves_of
from .translate import Program
from .types import RecordType, Static, Type, at_run_time, type_of

_PUBLIC = ("reset", "update", "activate", "deactivate", "parameters", "retune", "self_test")
_ANSWERS = 8  # of the self-test


# The numbers of an input, as files and tables have them: their names, their types in C.
CELLS = {
    "stamp_ns": "int64_t",
    **dict.fromkeys(("position", "velocity", "hip_position", "hip_velocity", "effort"), "double"),
    "has_reference": "bool",
    "reference": "double",
}


class LawState(NamedTuple):
    """A bare law between two updates."""

    memory: LawMemory
    sample: Sample  # the last one


def law_retuned(state: LawState, law: Law, before: Any, after: Any, limits: Limits) -> LawState:
    """Return the state under new constants, adapted by the law so that the command does not jump."""
    memory = law.reconfigure(state.memory, state.sample, before, after)
    return state._replace(memory=memory._replace(effort=limited(memory.effort, limits)))


class ExportedStep(NamedTuple):
    """An input of the controller, the answer of CPython or of a recording, and whether it is compared."""

    reading: Reading
    effort: float
    compared: bool

    @property
    def numbers(self) -> tuple[int | float, ...]:
        """The input's `CELLS`, and the answer."""
        r = self.reading
        motion = (r.position, r.velocity, *r.hip, r.effort)
        return r.stamp_ns, *motion, r.has_reference, r.reference, self.effort


@dataclass
class ExportedController:
    """A controller's translation. ``bare``: the law's update alone; ``name``: in C, by default the law's.

    Raises UntranslatableError for a law outside of the subset.
    """

    law: Law
    config: ControllerConfig
    bare: bool = False
    name: str = ""
    program: Program = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.name or self.law.name
        self.program = p = Program(f"{self.name}_")
        p.names |= {f"{self.name}_{public}" for public in _PUBLIC}
        p.names |= {f"{self.name}_{n}" for n in ("Controller", "Parameters", "widened")}
        p.names |= {"SETTINGS", "INITIAL"}
        law, config = self.law, self.config
        self.settings = settings_of(config, law)
        memory_class = (type(law.memory),)
        self.constants_type: Type = type_of(config.constants)
        assert isinstance(self.constants_type, RecordType)
        if self.constants_type.kind is None:
            p.titles[self.constants_type] = "Constants"
        self.settings_type = type_of(self.settings, changing=memory_class)
        self.limits_type = type_of(self.settings.limits)
        memory, limits = self.settings.initial, self.limits_type
        self.initial: Any = initial_state(not config.active_times, Seen(), memory)
        if self.bare:
            self.initial = LawState(memory, Sample(0.0, 0.0, 0.0, 0.0))
        self.state_type = state = type_of(self.initial, changing=memory_class)
        functions = [Static(law.update), Static(law.transfer)]
        given = [state, self.input_type, self.settings_type, self.constants_type, *functions]
        if self.bare:
            assert isinstance(state, RecordType)
            self.update = p.function(law.update, [*state.types, self.constants_type, limits])
        else:
            assert isinstance(self.settings_type, RecordType)
            self.update = p.function(decide, given)
            self.activate = p.function(activated, [state, self.settings_type.types[1]])
            self.deactivate = p.function(deactivated, [state])
        tuned = [state, Static(law), self.constants_type, self.constants_type, limits]
        self.retune = p.function(law_retuned if self.bare else reconfigured, tuned)
        self.leaves: list[Leaf] = leaves_of(config, p, self.constants_type)

    @property
    def input_type(self) -> RecordType:
        """The record that an update takes."""
        t = type_of(Sample(0.0, 0.0, 0.0, 0.0)) if self.bare else type_of(Reading(0, 0.0, 0.0))
        assert isinstance(t, RecordType)
        return t

    @property
    def output_type(self) -> RecordType:
        """The record that an update gives."""
        t = self.update.outputs[-1][1]
        assert isinstance(t, RecordType)
        return t

    @cached_property
    def public_records(self) -> list[RecordType]:
        """The records of the header, each behind those that it contains."""
        wanted: set[RecordType] = set()
        for t in (self.state_type, self.constants_type, self.input_type, self.output_type):
            _add(t, wanted)
        return [record for record in self.program.records if record in wanted]

    @cached_property
    def private_records(self) -> list[RecordType]:
        """The records of the source alone."""
        return [record for record in self.program.records if record not in self.public_records]

    @property
    def values(self) -> dict[str, Any]:
        """The parameters by their names."""
        return values_of(self.config)

    # What is told about it -------------------------------------------------------------------------------

    @property
    def digest(self) -> str:
        """The digest of the parameters: 16 hex digits of SHA-256 over their names and values, sorted."""
        values = {name: repr(value) for name, value in sorted(self.values.items())}
        return hashlib.sha256(json.dumps(values).encode()).hexdigest()[:16]

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the sources that were translated: 16 hex digits of SHA-256."""
        files = {Path(f.python.__code__.co_filename) for f in self.program.ordered}
        digest = hashlib.sha256()
        for path in sorted(files, key=lambda path: (path.name, str(path))):
            digest.update(path.read_bytes())
        return digest.hexdigest()[:16]

    @property
    def package(self) -> str:
        """The package of the law."""
        try:
            return package_of(self.law.name)
        except KeyError:  # not registered
            return str(self.law.update.__module__).partition(".")[0]

    @property
    def licence(self) -> str:
        """The licence of the law's package."""
        from importlib.metadata import PackageNotFoundError, metadata

        try:
            return str(metadata(self.package)["License"] or "see its package")
        except (PackageNotFoundError, KeyError):
            return "see its package"

    # What CPython answers --------------------------------------------------------------------------------

    def answers(self, count: int = _ANSWERS) -> list[ExportedStep]:
        """Return inputs around the upright, and CPython's answers; every update is due."""
        rng = random.Random(self.digest)
        readings = []
        for k in range(count):
            theta, omega, x, v, acting = (rng.uniform(-0.5, 0.5) for _ in range(5))
            readings.append(
                Reading(k * self.config.period_ns, theta, 4.0 * omega, Hip(x, v), 20.0 * acting)
            )
        return self.answered(readings)

    def answered(self, readings: list[Reading]) -> list[ExportedStep]:
        """Return CPython's answers to readings, one after the other."""
        rows = []
        memory, constants = self.settings.initial, self.config.constants
        controller = Controller(self.config, self.law)
        for reading in readings:
            if self.bare:
                limits = self.settings.limits
                memory, terms = self.law.update(memory, self.sample(reading), constants, limits)
                rows.append(ExportedStep(reading, terms.effort, True))
            else:
                output = controller.decide(reading)
                rows.append(ExportedStep(reading, output.effort, output.active))
        return rows

    def sample(self, reading: Reading) -> Sample:
        """Return a reading as the bare law takes it: every period is its own."""
        dt = seconds(self.config.period_ns)
        return Sample(reading.reference, reading.position, reading.velocity, dt, reading.hip)


def _add(t: Type, wanted: set[RecordType]) -> None:
    if isinstance(t, RecordType) and at_run_time(t):
        wanted.add(t)
        for inner in t.types:
            _add(inner, wanted)
