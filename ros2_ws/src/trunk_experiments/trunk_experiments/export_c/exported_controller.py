"""A registered law with its parameters as C: what is translated, and the texts that it makes."""

from __future__ import annotations

import hashlib
import json
import random
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from trunk_control.controller import Controller, settings_of
from trunk_control.decide import (
    Output,
    Reading,
    Seen,
    activated,
    deactivated,
    decide,
    initial_state,
    reconfigured,
)
from trunk_control.law import ControllerConfig, Hip, Law
from trunk_control.laws import package_of
from trunk_core.c.translate import Program
from trunk_core.c.types import REAL, RecordType, Static, Type, type_of
from trunk_core.parameters.declarations import (
    Declaration,
    ParameterError,
    build,
    declarations,
    values_of,
)

_PUBLIC = ("reset", "update", "activate", "deactivate", "parameters", "retune", "self_test")
_ANSWERS = 8  # of the self-test
_FACTORS = (1.0009765625, 0.9990234375, 1.0732421875, 0.8798828125)

# The numbers of an input, as files and tables have them: their names, their types in C.
CELLS = {
    "stamp_ns": "int64_t",
    **dict.fromkeys(("position", "velocity", "hip_position", "hip_velocity", "effort"), "double"),
    "has_reference": "bool",
    "reference": "double",
}


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


class Leaf(NamedTuple):
    """A parameter that is a number of the constants: its declaration, its name and its place in C."""

    declaration: Declaration
    name: str
    place: str  # behind the constants


@dataclass
class ExportedController:
    """A controller's translation. ``name``: in C, by default the law's.

    Raises UntranslatableError for a law outside of the subset.
    """

    law: Law
    config: ControllerConfig
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
        memory = self.settings.initial
        self.initial = initial_state(not config.active_times, Seen(), memory)
        self.state_type = state = type_of(self.initial, changing=memory_class)
        self.input_type = type_of(Reading(0, 0.0, 0.0))
        output = Output(False, 0.0, False, False, 0.0, self.settings.no_terms)
        self.output_type = type_of(output)
        for t in (state, self.constants_type, self.input_type, self.output_type):
            p.c_type(t)
        self.public_records = list(p.records)  # of the header; the others are of the source alone
        functions = [Static(law.update), Static(law.transfer)]
        given = [state, self.input_type, self.settings_type, self.constants_type, *functions]
        assert isinstance(self.settings_type, RecordType)
        self.update = p.function(decide, given)
        self.activate = p.function(activated, [state, self.settings_type.types[1]])
        self.deactivate = p.function(deactivated, [state])
        limits = self.settings_type.types[0]
        tuned = [state, Static(law), self.constants_type, self.constants_type, limits]
        self.retune = p.function(reconfigured, tuned)
        self.leaves = list(_leaves_of(config, p, self.constants_type))

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
        files = {Path(f.python.__code__.co_filename) for f in self.program.functions.values()}
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
        controller = Controller(self.config, self.law)
        outputs = [(reading, controller.decide(reading)) for reading in readings]
        return [ExportedStep(reading, out.effort, out.active) for reading, out in outputs]


def _leaves_of(config: ControllerConfig, program: Program, t: Type) -> Iterator[Leaf]:
    """Yield the parameters that may change while the controller runs and are one number of its constants.

    Each is tried with other values: exactly that number takes the value, bit by bit, and all else keeps its
    bits.
    """
    for name, declared in declarations(type(config)).items():
        if declared.fixed or declared.kind != "double":
            continue
        places = {_place_of(config, name, factor, program, t) for factor in _FACTORS} - {None}
        if len(places) == 1 and (place := places.pop()):
            yield Leaf(declared, name.replace(".", "_"), place)


def _place_of(
    config: ControllerConfig, name: str, factor: float, program: Program, t: Type
) -> str | None:
    """Return the number that a parameter is; empty if it is none, None if the value is not allowed."""
    values = values_of(config)
    value = float(values[name]) * factor or 0.001953125 * factor  # type: ignore[arg-type]
    try:
        other = build(type(config), {**values, name: value})
    except ParameterError:
        return None
    before, after = (list(_numbers(program, c.constants, t)) for c in (config, other))
    changed = [new for old, new in zip(before, after, strict=False) if old != new]
    single = len(after) == len(before) and len(changed) == 1
    return changed[0][0] if single and changed[0][1] == struct.pack("<d", value) else ""


def _numbers(program: Program, value: Any, t: Type, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the places of the doubles of a value and their bits; everything else as it is."""
    if isinstance(t, RecordType):
        for i, (item, inner) in enumerate(zip(value, t.types, strict=True)):
            yield from _numbers(program, item, inner, f"{place}.{program.field(t, i)}")
    else:
        yield place, struct.pack("<d", value) if t == REAL else repr(value)
