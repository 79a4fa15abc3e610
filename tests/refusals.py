"""Parameters that are refused, whichever door they come through: tests/test_refusals.py, tests/graph."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml

from trunk_core.parameters.declarations import declarations
from trunk_runs.nodes import NODES

_S = "S S S S S S S"
_B = "B B B B B B B"
_REST = ", ".join([_B] * 6)
_THREE = "fuzzy.error_peaks: [-1.0, 0.0, 1.0], fuzzy.rate_peaks: [-1.0, 0.0, 1.0]"
_GRID = "rules.kp: [S S S, S S S, S S S], rules.kd: [S S S, S S S, S S S], rules.alpha: [S S S, S S S, S S S]"
_REFERENCE = "reference.profile: interpolated, reference.times"

# Node; parameters, of which the first is named; what the line says is allowed.
_TABLE = f"""
simulator | update_rate: 0.0 | double, >= 0.001 and <= 1e+06
simulator | plant.trunk_mass: -0.5 | double, > 0 and <= 1e+06
simulator | plant.length: long | double, > 0 and <= 1000
simulator | plant.gravity: .nan | finite double, >= 0 and <= 1000
simulator | substeps: 0 | integer, >= 1 and <= 10000
simulator | substeps: 2.0 | integer, >= 1 and <= 10000
simulator | substeps: true | integer, >= 1 and <= 10000
simulator | hip.mode: walking | string, one of passive, prescribed
simulator | initial.position: [0.25] | double array of 2
simulator | initial.position: [0.0, 0.5, 1.0] | double array of 2
simulator | initial.position: 0.5 | double array of 2
simulator | initial.velocity: [0.0, .nan] | finite double array of 2
simulator | initial.position: [1000000.0, 0.1], path.wavenumber: 2.0 | the phase on a path among them
simulator | path.cosines: [0.1, .nan] | finite double array of at most 32
simulator | path.cosines: {[0.1] * 33} | double array of at most 32
simulator | path.sines: {[0.1] * 33} | double array of at most 32
simulator | path.sines: [0.1, -10000.0] | double array of at most 32, each >= -1000
simulator | plant.equations: literal | one of derived, as_printed
simulator | plant.equations: as_printed, path.amplitude: 0.5 | the paper prints no other case
simulator | plant.equations: as_printed, path.wavenumber: 0.5 | the paper prints no other case
simulator | plant.equations: as_printed, path.cosines: [0.5] | the paper prints no other case
simulator | plant.equations: as_printed, path.sines: [0.0, 0.5] | the paper prints no other case
simulator | max_effort: 0.0 | double, > 0
simulator | joints: [trunk, trunk] | two names
simulator | wait_for: x | string array, each one of effort_command
simulator | wait_for: [nobody] | string array, each one of effort_command
simulator | wait_for: [recorder], lockstep.enabled: true | effort_command
simulator | wait_for: [disturbance, reference], lockstep.enabled: true | effort_command
simulator | link.command.delay: 10.0, update_rate: 1000000.0 | steps late at this
simulator | plant.masss: 1.0 | no such parameter; did you mean 'plant.hip_mass'?
simulator | plant.mass: 1.0 | no such parameter; did you mean 'plant.hip_mass' or 'plant.trunk_mass'?
simulator | link.loss: 1.0 | no such parameter; did you mean 'link.state.loss' or 'link.state.burst.loss' or
disturbance | pulse.magnitude: .nan | finite double
disturbance | pulse.start_times: [1.0, -1.0] | double array of at most 10000, each >= 0
disturbance | pulse.channel: head | string, one of hip_effort, trunk_effort
disturbance | pulse.random_until: 1.0, pulse.random_from: 2.0, pulse.random_count: 1 | at least pulse.random
disturbance | noise.components: 0 | integer, >= 1 and <= 4096
disturbance | noise.high_frequency: 0.25 | greater than noise.low_frequency (0.5)
disturbance | table.values: [], table.times: [1.0] | as many as table.times (1)
disturbance | table.times: [2.0, 1.0], table.values: [0.0, 0.0] | ascending times
pid | gains.p: -60.0 | double, >= 0 and <= 1e+09
pid | gains.p: [80.0] | double, >= 0 and <= 1e+09
pid | gains.p: true | double, >= 0 and <= 1e+09
pid | gains.p: much | double, >= 0 and <= 1e+09
pid | gains.i: .nan | finite double, >= 0 and <= 1e+09
pid | gains.d: .inf | finite double, >= 0 and <= 1e+09
pid | gains.p_max: 1.0 | no such parameter; did you mean
pid | gain.p: 1.0 | no such parameter; did you mean 'gains.p'?
pid | mass: 1.0 | no such parameter; trunk params lists them all
pid | update_rate: true | double, >= 0.001 and <= 1e+06
pid | joint: 3 | string; a text that reads as a number
pid | derivative_mode: gyro | string, one of error, measurement, rate
pid | antiwindup_strategy: NONE | string, one of none, conditional_integration
pid | u_clamp_max: .nan | finite double
pid | u_clamp_max: -100.0 | greater than u_clamp_min (-100)
pid | i_clamp_max: -1.0 | double, >= 0
pid | i_clamp_min: 1.0 | double, <= 0
pid | active.times: [1.0, 1.0] | ascending
pid | active.times: [2.0, 1.0] | ascending
pid | reference.profile: ramp | one of constant, step, sine, sequence, interpolated
pid | reference.profile: interpolated | at least one of reference.times is needed
pid | reference.times: {[0.0] * 10_001} | of at most 10000
pid | reference.times: [2.0, 1.0], reference.values: [0.1, 0.2] | ascending times
pid | reference.values: [1.0] | as many as reference.times (0)
pid | reference.values: [1.0, 2.0], {_REFERENCE}: [1.0] | as many as reference.times (1)
fuzzy_pid | gains.p_max: 31.0 | at least gains.p_min (32)
fuzzy_pid | gains.d_max: 9.0 | at least gains.d_min (9.6)
fuzzy_pid | gains.d_min: 0.0 | double, > 0
fuzzy_pid | fuzzy.error_range: 0.0 | double, > 0 and <= 1000
fuzzy_pid | fuzzy.error_range: 1000.5 | double, > 0 and <= 1000
fuzzy_pid | fuzzy.rate_range: 0.0 | double, > 0 and <= 100000
fuzzy_pid | fuzzy.error_peaks: [-1.0, -0.5, -0.5, 0.0, 0.3, 0.6, 1.0] | strictly increasing peaks
fuzzy_pid | fuzzy.error_peaks: [0.0, .nan] | finite double array of 2 to 64
fuzzy_pid | fuzzy.rate_peaks: [0.0, 1.5] | each >= -1 and <= 1
fuzzy_pid | fuzzy.rate_peaks: [0.0] | double array of 2 to 64, each >= -1
fuzzy_pid | fuzzy.alpha_centers: [2.0, 3.0, 4.0] | as many as fuzzy.alpha_labels (4:
fuzzy_pid | fuzzy.alpha_centers: [2.0, .nan, 4.0, 5.0] | each > 0
fuzzy_pid | fuzzy.kp_centers: [0.5] | as many as fuzzy.kp_labels (2: S, B)
fuzzy_pid | fuzzy.kd_centers: [0.0, 1.5] | each >= 0 and <= 1
fuzzy_pid | fuzzy.kp_labels: [S, S] | S is there twice
fuzzy_pid | fuzzy.kp_labels: [], fuzzy.kp_centers: [], {_THREE}, {_GRID} | 1 to 64
fuzzy_pid | fuzzy.kp_centers: [], {_THREE}, {_GRID} | 1 to 64
fuzzy_pid | fuzzy.rate_labels: [L, R] | one label for each of the 7 peaks
fuzzy_pid | rules.kp: [{_B}] | string array of 2 to 64
fuzzy_pid | rules.kp: [{_S}, {_S}, {_S}, S S S S S S MS, {_S}, {_S}, {_S}] | cell (e ZO, e_dot PB) is 'MS'
fuzzy_pid | rules.kd: [{_B}, {_B}, S S B X B S S, {_B}, {_B}, {_B}, {_B}] | labels S, B, or numbers from 0
fuzzy_pid | rules.kd: [S S S S S S 1.1, {_REST}] | to 1; cell (e NB, e_dot PB) is '1.1'
fuzzy_pid | rules.kd: [S S S S S S nan, {_REST}] | to 1; cell (e NB, e_dot PB) is 'nan'
fuzzy_pid | rules.kd: [{_S}, {_S}, {_S}, {_S}, {_S}, {_S}] | 7 rows, one per label of e; there are 6
fuzzy_pid | rules.alpha: [S S, S S, S S, S S, S S, S S, S S] | 7 labels in each row; row 1 (e NB) has 2
fuzzy_pid | rules.kp.NM.PX: S | PX is no column of rules.kp: NB, NM, NS, ZO, PS, PM, PB
fuzzy_pid | rules.kp.NX.PM: S | NX is no row of rules.kp: NB, NM, NS, ZO, PS, PM, PB
fuzzy | rules.u: {["NB ZO"] * 7} | 7 labels in each row
fuzzy | fuzzy.output_centers: [0.0, 1.0] | as many as fuzzy.output_labels (7: NB, NM
fuzzy | fuzzy.output_centers: {[-1.5] * 7} | each >= -1 and <= 1
fuzzy | fuzzy.form: pid | one of pd, pi
recorder | overwrite: 3 | bool
"""


class Refusal(NamedTuple):
    """Values of a node's parameters, and what is said of the first."""

    node: str
    values: dict[str, Any]
    allowed: str

    def __str__(self) -> str:
        return f"{self.node}.{self.settings[0]}"[:60]

    @property
    def settings(self) -> list[str]:
        """The values as a command line has them: NAME=VALUE."""
        texts = (json.dumps(value) for value in self.values.values())
        plain = (text.replace("NaN", ".nan").replace("Infinity", ".inf") for text in texts)
        return [f"{name}={text}" for name, text in zip(self.values, plain, strict=True)]

    @property
    def running(self) -> Refusal:
        """Return what a running node says: it changes nothing that is fixed at start."""
        declared = declarations(NODES[self.node].config).get(next(iter(self.values)))
        return self._replace(allowed="fixed at start") if declared and declared.fixed else self

    def check(self, line: str) -> None:
        """Fail unless it is one line that names the parameter, its value and what is allowed."""
        name, value = next(iter(self.values.items()))
        known = not self.allowed.startswith("no such")
        said = f"parameter {name!r}: {repr(value)[:60]}" if known else name
        assert "\n" not in line
        assert said in line, line
        before = "is not allowed: " if known else name
        assert before in line, line
        assert self.allowed in line.rpartition(before)[2], line


def _refusals() -> Iterator[Refusal]:
    for row in _TABLE.strip().splitlines():
        node, values, allowed = row.split(" | ")
        yield Refusal(node, yaml.safe_load(f"{{{values}}}"), allowed)


REFUSALS = list(_refusals())
