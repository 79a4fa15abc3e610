"""Numbers with units in a study's file: in SI units once read."""

from __future__ import annotations

import json
import math

import pytest

from trunk_experiments.errors import StudyError
from trunk_experiments.study.rows import identity, make_bases
from trunk_experiments.study.study import parse_study

HEAD = """
scenario: fig8
rate: 0.5 kHz
duration: 500 ms
controllers: [pid, fuzzy_pid]
set: {disturbance.pulse.duration: 100 ms}
vary:
"""
DELAY = "  delay: {parameter: simulator.sensor.delay, %s}\n"
SIZE = "  size: {parameter: disturbance.pulse.magnitude, values: [50 N]}\n"


def study_of(vary):
    study = parse_study(HEAD + vary, "study.yaml")
    return study, make_bases(study)


def test_rate_duration_and_settings_take_units():
    study, bases = study_of(DELAY % "values: [0.0]")
    assert (study.rate, study.duration) == (500.0, 0.5)
    assert all(base.disturbance.pulse_duration == 0.1 for base in bases.values())


@pytest.mark.parametrize(
    ("vary", "values"),
    [
        (DELAY % "values: [0, 10 ms, 0.02]", (0, 0.01, 0.02)),
        (DELAY % "from: 0 ms, to: 100 ms, steps: 3", (0.0, 0.05, 0.1)),
        ("  p: {parameter: pid.gains.p, as: factor, values: [80%, 1.2]}\n", (0.8, 1.2)),
        (
            "  p: {parameter: [pid.gains.p, fuzzy_pid.gains.p_max], as: offset, values: [5 Nm/rad]}\n",
            (5.0,),
        ),
        (
            "  angle: {parameter: 'simulator.initial.position[1]', values: [10 deg]}\n",
            (math.radians(10.0),),
        ),
        (
            "  size: {parameter: disturbance.pulse.magnitude, values: [100 deg]}\n",
            (math.radians(100.0),),
        ),
    ],
)
def test_a_grid_takes_units(vary, values):
    study, _ = study_of(vary)
    assert study.variables[0].values == values


def test_a_distribution_takes_units():
    study, _ = study_of(DELAY % "distribution: normal, mean: 20 ms, std: 5ms, low: 0, high: 1e3 us")
    drawn = study.variables[0].distribution
    assert (drawn.mean, drawn.std, drawn.low, drawn.high) == (0.02, 0.005, 0.0, 0.001)
    study, _ = study_of(DELAY % "distribution: choice, values: [1 ms, 0.002]")
    assert study.variables[0].distribution.values == (0.001, 0.002)


def test_the_channel_of_a_disturbance_chooses_the_unit():
    says = r"'50 N' is not allowed where pulse\.channel is {}: it is a force; {} is needed"
    with pytest.raises(StudyError, match=says.format("trunk_position", "an angle in rad")):
        study_of(SIZE)
    where = "  where: {parameter: disturbance.pulse.channel, values: [%s]}\n"
    study_of(SIZE + where % "hip_effort")
    with pytest.raises(StudyError, match=says.format("trunk_effort", "a torque in N m")):
        study_of(SIZE + where % "hip_effort, trunk_effort")


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        (DELAY % "values: [5 kg]", "vary.delay.values: is '5 kg': it is a mass; a time in s"),
        (DELAY % "from: 0, to: 5 m, steps: 2", "vary.delay.to: is '5 m': it is a length; a time"),
        (DELAY % "as: factor, values: [5 ms]", "is '5 ms': it is a time; a plain number is needed"),
        (
            DELAY % "distribution: uniform, low: 0 sec, high: 1",
            "vary.delay.low: is '0 sec': there is no unit 'sec' (did you mean 's'?); a time in s",
        ),
        (
            "  both: {parameter: [pid.gains.p, simulator.sensor.delay], values: [5 ms]}\n",
            "is '5 ms': it is a time; a quantity in N m/rad is needed",
        ),
        (
            "  one: {parameter: 'simulator.initial.position[0]', values: [5 deg]}\n",
            "is '5 deg': it is an angle; a length in m is needed",
        ),
        (
            "  mode: {parameter: simulator.hip.mode, values: [5 m]}\n",
            "'5 m' is not allowed: string, one of passive, prescribed",
        ),
        (
            "  p: {parameter: controller.gains.p, values: [5 N m/rad]}\n",
            "fuzzy_pid: controller.gains.p: no such parameter",
        ),
        (
            "  e: {parameter: simulator.max_effort, values: [inf N m]}\n",
            "is inf: a finite number is needed",
        ),
    ],
)
def test_a_mistake_names_file_entry_value_and_what_is_allowed(vary, says):
    with pytest.raises(StudyError) as caught:
        study_of(vary)
    assert str(caught.value).startswith("study.yaml: ")
    assert says in str(caught.value)


def test_how_a_number_is_written_does_not_change_the_study():
    """Blocks of an interrupted sweep stay usable."""
    with_units, plain = (
        identity(*study_of(DELAY % f"values: [{values}]")) for values in ("0.0, 10 ms", "0.0, 0.01")
    )
    assert with_units == plain
    assert "written" not in json.dumps(plain["variables"])
