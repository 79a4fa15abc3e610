"""A controller's run in a lab as one C text: the loop in segments, changes on the way, metrics, rules.

Clang and lld compile it to WebAssembly: the system's, or those of PyPI's ziglang.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trunk_control.decide import reconfigured
from trunk_control.fuzzy import fired_at
from trunk_control.law import Law
from trunk_control.laws import law_named
from trunk_control.rule_base import RuleBaseConfig
from trunk_core.arrays import Floats
from trunk_core.c.program import Translated, template
from trunk_core.c.translate import Program, indented
from trunk_core.c.types import (
    INTEGER,
    REAL,
    Array,
    RecordType,
    Scalar,
    Static,
    TableType,
    Type,
    at_run_time,
    type_of,
)
from trunk_core.errors import PlanError
from trunk_evidence.run_metrics import Measured, no_rows, numbers_of, steady_from, with_rows
from trunk_runs.engine import FRESH, REFERENCE, keep_states, write_terms
from trunk_runs.loop import Chain, Instant, Keep, LoopState, Schedule, Surroundings, segment_of
from trunk_runs.plan import RunPlan
from trunk_sim.disturbances import Disturbance, disturbance_at
from trunk_sim.noise import standard_normal
from trunk_sim.step import PlantConstants, at_rest, torque_of
from trunk_studies.batch.compiled_run import start_of_loop

# Columns of the table, up to the terms: those of `trunk_runs.engine`.
NAMES = (
    *("x", "theta", "x_dot", "theta_dot"),
    *("seen_x", "seen_theta", "seen_x_dot", "seen_theta_dot"),
    *("torque", "hip_force", "trunk_torque", "hip_offset", "trunk_offset"),
    *("command", "fresh", "reference", "seen_torque", "active", "fallen"),
)
THETA = NAMES.index("theta")


def keep_with_drive(column: int) -> Keep:
    """Return `keep_states` that also writes the torque over the step from the state, N m, into a column."""

    def keep(out: Floats, row: int, instant: Instant, plant: PlantConstants) -> None:
        keep_states(out, row, instant, plant)
        out[row, column] = torque_of(instant.trunk.effort, instant.effort, plant)

    return keep


class Fired(NamedTuple):
    """Row and column of the first of the four rules that fire, and their weights."""

    row: float
    column: float
    w00: float
    w01: float
    w10: float
    w11: float


def rules_at(
    error: float, rate: float, error_peaks: Sequence[float], rate_peaks: Sequence[float]
) -> Fired:
    """Return the rules that fire at e [rad] and e_dot [rad/s]; for display."""
    rules = fired_at(error, rate, error_peaks, rate_peaks)
    return Fired(
        float(rules[0].row),
        float(rules[0].column),
        rules[0].weight,
        rules[1].weight,
        rules[2].weight,
        rules[3].weight,
    )


CHUNK = 1024  # states that a segment computes at most
# A compiler may call these for records, whatever the text says.
_COPIES = """
void *memcpy(void *to, const void *from, unsigned long count);
void *memcpy(void *to, const void *from, unsigned long count) {
    for (unsigned long i = 0; i < count; i++) {
        ((unsigned char *)to)[i] = ((const unsigned char *)from)[i];
    }
    return to;
}
void *memset(void *to, int value, unsigned long count);
void *memset(void *to, int value, unsigned long count) {
    for (unsigned long i = 0; i < count; i++) {
        ((unsigned char *)to)[i] = (unsigned char)value;
    }
    return to;
}
"""


class LoopValues(NamedTuple):
    """What determines a run besides what comes from outside."""

    surroundings: Surroundings
    state: LoopState
    participants: Chain


class LoopNumber(NamedTuple):
    """A number among a run's values: its place in C, its C type and its value; anything else has no place."""

    place: str
    kind: str
    value: object


def numbers_of_loop(plan: RunPlan) -> list[LoopNumber]:
    """Return the numbers of a plan's loop, in the order of `LabProgram`'s places, and all else in it."""
    program = Program()
    values = LoopValues(*start_of_loop(plan))
    return [
        number
        for name, value in values._asdict().items()
        for number in _numbers(program, name, name, value, type_of(value))
    ]


def values_of_loop(plan: RunPlan) -> list[object]:
    """Return the values of `numbers_of_loop` alone, which takes a tenth of the time."""
    values: list[object] = []
    _flatten(start_of_loop(plan), values)
    return values


def _flatten(value: Any, values: list[object]) -> None:
    if isinstance(value, tuple):
        for item in value:
            _flatten(item, values)
    elif isinstance(value, np.ndarray):
        values.append(value.shape)
        values += value.reshape(-1).tolist()
    else:
        values.append(value)


def _numbers(program: Program, place: str, path: str, value: Any, t: Type) -> Iterator[LoopNumber]:
    if isinstance(t, RecordType):
        for i, (name, item, inner) in enumerate(zip(t.names, value, t.types, strict=True)):
            c = f"{place}.{program.field(t, i)}"
            yield from _numbers(program, c, f"{path}_{name}", item, inner)
    elif isinstance(t, Array):
        yield LoopNumber("", "", value.shape)
        for i, item in enumerate(value.reshape(-1).tolist()):
            yield LoopNumber(f"{path}_data[{i}]", t.element.c, item)
    elif isinstance(t, Scalar) and t.c:
        yield LoopNumber(place, t.c, value)
    elif isinstance(t, TableType):
        yield from (LoopNumber("", "", item) for item in value)
    else:
        yield LoopNumber("", "", value)


def with_value(program: Program, name: str, value: Any) -> list[str]:
    """Return the definition of a variable with a value, behind those of its arrays, ``PATH_data``."""
    t, lines = type_of(value), list[str]()
    program.names.add(name)
    text = _initial(program, name, value, t, lines)
    return [*lines, f"static {program.c_type(t)} {name} = {text};"]


def _initial(program: Program, path: str, value: Any, t: Type, lines: list[str]) -> str:
    """Return the initialiser of a value; the definitions of its arrays' elements are appended to lines."""
    if isinstance(t, Array):
        items = value.reshape(-1).tolist() or [0]
        text = f" = {{{', '.join(map(program.literal, items))}}}" if any(items) else ""
        lines.append(f"static {t.element.c} {path}_data[{len(items)}]{text};")
        return f"{{{path}_data, {', '.join(map(str, value.shape))}}}"
    if not isinstance(t, RecordType):
        return program.initial(value, t)
    inside = ", ".join(
        _initial(program, f"{path}_{name}", item, inner, lines)
        for name, item, inner in zip(t.names, value, t.types, strict=True)
        if at_run_time(inner)
    )
    return f"{{{{{inside}}}}}" if t.row else f"{{{inside}}}"


@dataclass
class LabProgram:
    """A plan's run with one controller, as C; its functions are called by name from WebAssembly.

    Raises UntranslatableError for a law outside of the subset.
    """

    plan: RunPlan
    name: str  # the controller's
    text: str = field(init=False)
    columns: tuple[str, ...] = field(init=False)  # of the table
    exports: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        config = self.plan.controllers[self.name]
        law = law_named(self.name)
        self.columns = (*NAMES, *law.record_names, "drive")
        self._program = Program()
        self._statics: list[str] = []
        self._functions: list[str] = []
        self._values = LoopValues(*start_of_loop(self.plan))
        self._segment(law)
        self._change(law)
        self._metrics()
        self._noise()
        if isinstance(config, RuleBaseConfig):
            self._rules(config)
        places = [number.place for number in numbers_of_loop(self.plan) if number.place]
        pointers = ",\n        ".join(f"(void *)&{place}" for place in places)
        self._export(
            "void *place_of(int32_t index)",
            f"static void *const places[] = {{\n        {pointers},\n    }};",
            "return places[index];",
        )
        tail = "\n\n".join([*self._statics, *self._functions])
        self.text = f"{self._program.library(tail)}\n{tail}\n{_COPIES}"

    def _static(self, name: str, value: Any) -> str:
        """Add a variable with a value; return it as an argument."""
        self._statics += with_value(self._program, name, value)
        return f"&{name}" if isinstance(value, tuple) else name

    def _call(self, f: Translated, *arguments: str) -> str:
        """Return the definition of ``next``, which is what a function returns."""
        return f"const {self._program.c_type(f.result)} next = {f.name}({', '.join(arguments)});"

    def _export(self, head: str, *lines: str) -> None:
        """Add a function that is called from outside."""
        body = "\n".join(indented(lines))
        self._functions.append(f"{head};\n{head} {{\n{body}\n}}")
        self.exports.append(head.partition("(")[0].split()[-1].lstrip("*"))

    def _segment(self, law: Law) -> None:
        """Add the loop with its values, and what computes the next states into the table."""
        surroundings, state, _ = self._values
        given = {
            **self._values._asdict(),
            "noise": np.zeros((CHUNK, 2)),
            "history": np.zeros((self.plan.simulator.delay_steps + 1, 4)),
            "schedule": Schedule(push=np.zeros((CHUNK, 2))),
            "table": np.zeros((CHUNK, len(self.columns))),
        }
        types = [type_of(value) for value in given.values()]
        f = self._program.function(
            segment_of(
                law,
                dynamics=self.plan.simulator.dynamics,
                keep=keep_with_drive(len(self.columns) - 1),
                tell=write_terms,
            ),
            [INTEGER, INTEGER, *types],
        )
        arguments = [self._static(name, value) for name, value in given.items()]
        self._statics.append("static int32_t ended;")
        self._export(
            "int32_t advance(int32_t first, int32_t stop)",
            self._call(f, "first", "stop", *arguments),
            "state = next.item2;",
            "ended = (int32_t)next.item1;",
            "return (int32_t)next.item0;",
        )
        self._export("int32_t how_it_ended(void)", "return ended;")
        plant = type_of(surroundings.plant)
        f = self._program.function(at_rest, [type_of(state.trunk.state), plant])
        self._export(
            "void begin(void)",
            f"state.trunk = {f.name}(&state.trunk.state, &surroundings.plant);",
        )
        for name in ("table", "noise", "schedule_push"):
            self._export(f"double *{name}_of(void)", f"return {name}_data;")
        f = self._program.function(disturbance_at, [INTEGER, type_of(surroundings.signals)])
        self._static("disturbance", Disturbance())
        call = f"disturbance = {f.name}(index * surroundings.period_ns, &surroundings.signals);"
        self._export(
            "void *disturbance_in(int32_t index)",
            call if surroundings.disturbed else "(void)index;",
            "return &disturbance;",
        )

    def _change(self, law: Law) -> None:
        """Add what takes over changed constants: ``remember``, then the changes, then ``take_over``."""
        participants, program = self._values.participants, self._program
        self._static("before", participants)
        t = type_of(participants)
        pairs = zip(
            _numbers(program, "before", "before", participants, t),
            _numbers(program, "participants", "participants", participants, t),
            strict=True,
        )
        self._export(
            "void remember(void)",
            *(f"{old.place} = {new.place};" for old, new in pairs if new.place),
        )
        assert isinstance(t, RecordType)
        assert isinstance(t.types[0], RecordType)
        settings, constants, _ = t.types[0].types
        memory = self._values.state.memories[0]
        memory_type = type_of(memory)
        assert isinstance(settings, RecordType)
        f = program.function(
            reconfigured, [memory_type, Static(law), constants, constants, settings.types[0]]
        )
        first = program.field(t, 0)
        own = f".{first}.{program.field(t.types[0], 1)}"
        limits = (
            f"&participants.{first}.{program.field(t.types[0], 0)}.{program.field(settings, 0)}"
        )
        held = f"state.memories.{first}"
        both = [f"&before{own}", f"&participants{own}"] if at_run_time(constants) else []
        call = f"{f.name}({', '.join([f'&{held}', *both, limits])})"
        self._export("void take_over(void)", f"{held} = {call};")

    def _metrics(self) -> None:
        """Add the metrics: ``measure`` from the first state on, row by row of the table, then ``metrics``."""
        program = self._program
        measured = Measured(no_rows(0.0), 0.0)
        self._static("measured", measured)
        self._static("begun", measured)
        t, sums = type_of(measured), type_of(measured.sums)
        table = Array(REAL, 2)
        columns = [THETA, len(self.columns) - 1, REFERENCE, FRESH]
        types = [t, INTEGER, INTEGER, INTEGER, REAL, *(INTEGER for _ in columns), table]
        rows = program.function(with_rows, types)
        level = program.function(steady_from, [REAL])
        period = self.plan.simulator.period_ns
        self._export(
            "void measure(int32_t first, int32_t count, int32_t states)",
            "if (first == 0) {",
            "    measured = begun;",
            "}",
            f"const double end = (double)((states - 1) * INT64_C({period})) / 1e9;",
            f"measured = {rows.name}(&measured, first, count, {period}, {level.name}(end), "
            f"{', '.join(map(str, columns))}, table);",
        )
        f = program.function(numbers_of, [sums, REAL])
        self._statics.append(f"static {program.c_type(f.result)} numbers;")
        call = f"numbers = {f.name}(&measured.sums, 0.0);"
        self._export("void *metrics(void)", call, "return &numbers;")

    def _noise(self) -> None:
        """Add the sensors' samples: ``seed``, then ``draw`` for the next of them, into ``noise``."""
        f = self._program.function(standard_normal, [INTEGER])
        self._statics += [template("pcg64.h"), "static Generator generator;"]
        self._export("void seed(int32_t number)", "generator = seeded(number);")
        self._export(
            "void draw(int32_t count)",
            "for (int32_t i = 0; i < count; i++) {",
            f"    noise_data[i] = {f.name}(random_bits(&generator));",
            "}",
        )

    def _rules(self, config: RuleBaseConfig) -> None:
        """Add which rules fire: ``rules``."""
        names = []
        for name, peaks in zip(("error_peaks", "rate_peaks"), config.peaks, strict=True):
            names.append(self._static(name, np.array(peaks)))
        f = self._program.function(rules_at, [REAL, REAL, Array(REAL, 1), Array(REAL, 1)])
        self._static("fired", Fired(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        self._export(
            "void *rules(double error, double rate)",
            f"fired = {f.name}(error, rate, {', '.join(names)});",
            "return &fired;",
        )


_COMPILE = (
    *("-std=c99", "-O2", "-ffreestanding", "-fno-builtin", "-nostdlib"),
    *("-mbulk-memory", "-fvisibility=hidden"),
)
_LINK = ("-Wl,--no-entry", "-Wl,--strip-all", "-Wl,-z,stack-size=65536")
_TOOLS = ("clang", "wasm-ld")


def missing_tools() -> str:
    """Return why nothing can be compiled here, in one line; empty if it can."""
    missing = [name for name in _TOOLS if shutil.which(name) is None]
    if not missing or find_spec("ziglang"):
        return ""
    return (
        f"{' and '.join(missing)} not found: pip install -r requirements/lab.txt in the project's folder, "
        "which brings both, or install clang and lld"
    )


def _compiler() -> tuple[str, ...]:
    if all(map(shutil.which, _TOOLS)):
        return "clang", "--target=wasm32"
    return sys.executable, "-m", "ziglang", "cc", "--target=wasm32-freestanding"


def wasm_of(text: str, exports: Sequence[str]) -> bytes:
    """Return a C text as a WebAssembly module without imports, which exports these functions and its memory.

    Raises PlanError where clang or lld is missing, or refuses the text.
    """
    if reason := missing_tools():
        raise PlanError(f"a lab needs WebAssembly: {reason}")
    with tempfile.TemporaryDirectory(prefix="trunk-lab-") as folder:
        source, module = Path(folder, "lab.c"), Path(folder, "lab.wasm")
        source.write_text(text)
        names = [f"-Wl,--export={name}" for name in exports]
        command = [*_compiler(), *_COMPILE, *_LINK, *names, str(source), "-o", str(module)]
        caches = dict.fromkeys(("ZIG_LOCAL_CACHE_DIR", "ZIG_GLOBAL_CACHE_DIR"), folder)
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env={**os.environ, **caches}
        )
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error:" in line]
            raise PlanError(f"clang: {(lines or [done.stderr.strip() or 'no reason given'])[0]}")
        return module.read_bytes()
