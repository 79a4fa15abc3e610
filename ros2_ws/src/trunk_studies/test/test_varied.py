"""Numbers of many runs at once: the bits of one run's, each way that runs part, and what is refused."""

import math
import operator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.errors import PlanError, StudyError
from trunk_core.parameters.declarations import ParameterError
from trunk_studies import rows
from trunk_studies.batch.block import summaries
from trunk_studies.batch.varied import SplitError, Varied, by_path, each_run
from trunk_studies.robustness import survival
from trunk_studies.rows import make_bases, outcomes, plan_of, rows_of
from trunk_studies.study import Target, design, parse_study

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
OPERATORS = [operator.add, operator.sub, operator.mul, operator.truediv]


@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=9), st.sampled_from(OPERATORS))
def test_operations_have_the_bits_of_floats(pairs, operation):
    a, b = (np.array(numbers) for numbers in zip(*pairs, strict=True))
    with np.errstate(all="ignore"):
        for left, right in (
            (Varied(a), Varied(b)),
            (Varied(a), pairs[0][1]),
            (pairs[0][0], Varied(b)),
        ):
            x, y = (each_run(side, len(pairs)) for side in (left, right))
            try:
                expected = list(map(operation, x, y))
            except ZeroDivisionError:
                with pytest.raises(TypeError):
                    operation(left, right)
                continue
            assert operation(left, right).values.tobytes() == np.array(expected).tobytes()


@pytest.mark.parametrize("function", [math.sqrt, float, int, len, hash, "{:g}".format, range])
def test_what_would_lose_the_runs_raises(function):
    with pytest.raises(TypeError):
        function(Varied(np.array([1.0, 2.0])))


def test_rounding_gives_integers_that_are_only_values():
    ties = Varied(np.array([0.5, 1.5, -2.5, 1e15]))
    assert round(ties).values.tolist() == [round(x) for x in ties.values.tolist()]
    with pytest.raises(TypeError):
        round(ties) + 1
    with pytest.raises(TypeError):
        round(Varied(np.array([1e16])))


def test_runs_part_where_they_differ():
    x = np.array([3.0, -1.0, 0.0, 2.0, -4.0])

    def size(part):
        number = Varied(x[part])
        if number == 0.0:
            return "none"
        return max(number, -number)

    parts = {tuple(part): result for part, result in by_path(size, np.arange(5))}
    assert parts.pop((2,)) == "none"
    found = {
        i: v for part, r in parts.items() for i, v in zip(part, r.values.tolist(), strict=True)
    }
    assert found == {0: 3.0, 1: 1.0, 3: 2.0, 4: 4.0}
    with pytest.raises(SplitError):
        bool(Varied(x))


STUDY = """
scenario: demo
controllers: {controllers}
duration: 0.3
runs: 40
set: {settings}
vary:
{vary}
"""
ENTRIES = {
    "mass": "{parameter: simulator.plant.trunk_mass, as: factor, distribution: uniform, low: 0.5, high: 2}",
    "angle": "{parameter: 'simulator.initial.position[1]', distribution: uniform, low: -2, high: 2}",
    "lag": "{parameter: simulator.actuator.time_constant, distribution: uniform, low: 0, high: 0.05}",
    "noise": "{parameter: simulator.sensor.position_noise, distribution: choice, values: [0.0, 0.01]}",
    "delay": "{parameter: simulator.sensor.delay, distribution: uniform, low: 0, high: 0.05}",
    "pulse": "{parameter: disturbance.pulse.magnitude, distribution: normal, mean: 0, std: 1}",
    "start": "{parameter: 'disturbance.pulse.start_times[0]', distribution: uniform, low: 0, high: 0.2}",
    "width": "{parameter: disturbance.pulse.duration, distribution: uniform, low: 0, high: 0.2}",
    "level": "{parameter: controller.reference.value, distribution: uniform, low: -1, high: 1}",
    "limit": "{parameter: controller.u_clamp_max, distribution: uniform, low: -90, high: 500}",
    "gain": "{parameter: pid.gains.d, distribution: loguniform, low: 0.1, high: 10000}",
    "box": "{parameter: fuzzy_pid.gains.p_max, distribution: uniform, low: 20, high: 90}",
    "range": "{parameter: fuzzy_pid.fuzzy.error_range, distribution: uniform, low: 0.5, high: 2}",
    "fall": "{parameter: simulator.fall.angle, distribution: uniform, low: 0.2, high: 2}",
    "random": "{parameter: disturbance.pulse.random_count, values: [0, 2]}",
    "band": "{parameter: disturbance.noise.rms, values: [0.0, 1.0]}",
    "words": "{parameter: simulator.hip.mode, values: [passive, prescribed]}",
}  # fmt: skip


def study_of(names, settings="{}"):
    vary = "\n".join(f"  {name}: {ENTRIES[name]}" for name in names)
    both = "[pid, fuzzy_pid]" if {"box", "range"} & set(names) or "gain" not in names else "[pid]"
    return parse_study(
        STUDY.replace("{controllers}", both)
        .replace("{settings}", settings)
        .replace("{vary}", vary),
        "s",
    )


def each_alone(study, bases, columns):
    made = []
    for row in rows_of(columns):
        try:
            (summary,) = summaries([plan_of(study, bases, row)])
        except (ParameterError, PlanError) as error:
            summary = str(error)
        made.append(summary)
    return made


@pytest.mark.parametrize(
    "names",
    [
        ("mass", "angle", "pulse"),
        ("noise", "delay", "level", "gain"),
        ("lag", "words", "start", "width"),
        ("limit", "box", "angle"),
        ("range", "random", "fall"),
        ("band", "mass"),
    ],
    ids="-".join,
)
@pytest.mark.parametrize("settings", ["{}", "{simulator.fall.stop: true}"], ids=["", "fall"])
def test_rows_made_together_have_the_bits_of_rows_made_alone(names, settings):
    study = study_of(names, settings)
    bases, columns = make_bases(study), design(study, 0, study.total)
    ended = outcomes(study, bases, columns)
    expected = each_alone(study, bases, columns)
    for i, summary in enumerate(expected):
        if isinstance(summary, str):
            assert ended.refused[i] == summary
        else:
            assert ended.summary(i) == summary


def test_a_study_of_doubles_makes_no_plan_of_its_own_for_a_row(monkeypatch):
    study = study_of(("mass", "angle", "pulse"))
    bases, columns = make_bases(study), design(study, 0, study.total)
    plans = []
    monkeypatch.setattr(rows, "plan_of", lambda *given: plans.append(plan_of(*given)) or plans[-1])
    outcomes(study, bases, columns)
    assert len(plans) < study.total / 3


@pytest.mark.parametrize("how", ["values: [2, 2.0]", "distribution: choice, values: [2, 2.0]"])
def test_a_whole_double_is_no_integer_even_beside_the_integer(how):
    study = parse_study(
        f"scenario: demo\ncontrollers: [pid]\nruns: 9\nset: {{disturbance.noise.rms: 1.0}}\n"
        f"vary: {{n: {{parameter: simulator.substeps, {how}}}}}",
        "s",
    )
    with pytest.raises(StudyError, match=r"'substeps': 2\.0 is not allowed"):
        make_bases(study)


def test_a_limit_names_the_first_run_that_is_refused():
    study = parse_study(
        """
scenario: demo
controllers: [pid, fuzzy_pid]
duration: 0.1
vary:
  p: {parameter: fuzzy_pid.gains.p_max, values: [20.0, 60.0]}
  u: {parameter: pid.u_clamp_max, values: [1.0, -200.0]}
""",
        "s",
    )
    target = Target("simulator", "plant.trunk_mass")
    with pytest.raises(StudyError, match=r"run 1: .*gains.p_max"):
        survival(study, target, [0.4, 0.5])
