"""A study's mistakes: each gives one line with file, place, value and what is allowed."""

from __future__ import annotations

import numpy as np
import pytest

from trunk_experiments.errors import StudyError
from trunk_experiments.study.rows import identity, make_bases
from trunk_experiments.study.study import Distribution, parse_study, read_study

HEAD = "scenario: fig6\ncontrollers: [pid]\n"
DELAY = "vary:\n  delay: {parameter: simulator.sensor.delay, values: [0.0]}\n"


def vary(entry: str, head: str = HEAD) -> str:
    return f"{head}vary:\n  v: {{{entry}}}\n"


MISTAKES = {
    "no mapping": ("- 1\n", "the file: is [1]: a mapping is needed"),
    "not yaml": ("a: [1\n", "line 2: "),
    "a list for a key": ("? [a]\n: 1\n", "line 1: a list or mapping"),
    "an endless study": ("&a [*a]\n", "line 1: an alias, '*a'"),
    "a deep study": ("[" * 5000, "line 1: nested more than 50 deep"),
    "a key twice": (HEAD + HEAD, "line 3: 'scenario' appears twice"),
    "no such date": (HEAD + "params: 2026-13-45\n", "line 3: '2026-13-45' is no"),
    "unknown key": (HEAD + DELAY + "run: 3\n", "unknown key 'run': one of scenario"),
    "no scenario": ("controllers: [pid]\n" + DELAY, "scenario: missing"),
    "no controller": (HEAD.replace("pid", "pod") + DELAY, "controllers.pod: is 'pod': pid, fuzzy"),
    "no such scenario": (HEAD.replace("fig6", "fig5") + DELAY, "pid: no scenario 'fig5': give one"),
    "no such file": (HEAD + "params: nix\n" + DELAY, "pid: no parameter file 'nix'"),
    "bad set": (HEAD + "set: {simulator.mass: 3}\n" + DELAY, "parameter 'mass': no such parameter"),
    "bad rate": (HEAD + "rate: -1\n" + DELAY, "rate: is -1: a number > 0 is needed"),
    "runs of nothing": (HEAD + "runs: 3\n" + DELAY, "runs: is 3, but nothing is drawn"),
    "too many": (
        vary("parameter: simulator.sensor.delay, from: 0, to: 1, steps: 1000000")
        + "  w: {parameter: simulator.plant.length, from: 1, to: 2, steps: 1000}\n",
        "1000000000 runs in all: at most 100000000 are allowed",
    ),
    "no node": (
        vary("parameter: sim.plant.length, values: [1]"),
        "parameter 'sim.plant.length': NODE",
    ),
    "misspelt": (
        vary("parameter: simulator.plant.lenght, values: [1.0]"),
        "vary.v: pid: simulator.plant.lenght: no such parameter; did you mean 'plant.length'?",
    ),
    "out of bounds": (
        vary("parameter: simulator.plant.length, values: [1.0, -2.0]"),
        "vary.v: pid: simulator.plant.length: parameter 'plant.length': -2.0 is not allowed: double, > 0",
    ),
    "array": (
        vary("parameter: simulator.initial.position, values: [1.0]"),
        "name one element, [0] to [1]",
    ),
    "no array": (vary("parameter: 'simulator.plant.length[0]', values: [1.0]"), "leave out [...]"),
    "factor of an integer": (
        vary("parameter: simulator.substeps, as: factor, values: [2]"),
        "as factor: a double is needed, it is integer",
    ),
    "bad how": (
        vary("parameter: simulator.substeps, as: sum, values: [2]"),
        "value, factor, offset",
    ),
    "half a grid": (
        vary("parameter: simulator.plant.length, from: 1"),
        "needs values, or from, to",
    ),
    "log through zero": (
        vary("parameter: simulator.plant.length, from: 0, to: 1, steps: 3, spacing: log"),
        "spacing log from 0 to 1: both must be > 0",
    ),
    "no distribution": (
        vary("parameter: simulator.plant.length, distribution: gauss"),
        "is 'gauss': choice, integers, loguniform, normal, uniform is needed",
    ),
    "half a distribution": (
        vary("parameter: simulator.plant.length, distribution: normal, mean: 1"),
        "distribution normal: std is missing",
    ),
    "crossed ends": (
        vary("parameter: simulator.plant.length, distribution: uniform, low: 2, high: 1"),
        "low 2 is above high 1",
    ),
    "another controller": (
        vary("parameter: fuzzy_pid.gains.p_max, values: [60.0]"),
        "vary.v: fuzzy_pid.gains.p_max: that controller is not in the study",
    ),
    "drawn rate": (
        vary("parameter: simulator.update_rate, distribution: uniform, low: 100, high: 200"),
        "simulator.update_rate can only be varied by given values",
    ),
    "rates that do not fit": (
        vary("parameter: controller.update_rate, values: [700]", HEAD + "rate: 1000\n"),
        "700 Hz is not an integer divisor of the simulator's 1000 Hz",
    ),
    "reserved name": (
        HEAD + DELAY.replace("delay:", "draw:"),
        "vary.draw: is not a column name",
    ),
    "mixed": (
        vary("parameter: simulator.hip.mode, values: [passive, 2]"),
        "all numbers, all strings or all bools are needed",
    ),
    "no end": (HEAD + "set: {simulator.duration: 0.0}\n" + DELAY, "duration is 0"),
}


@pytest.mark.parametrize("number", ["1e999", "-1e+999", ".inf", ".nan"])
@pytest.mark.parametrize(
    ("place", "numbers"),
    [
        ("values", "values: [%s]"),
        ("from", "from: %s, to: 1, steps: 2"),
        ("low", "distribution: uniform, low: %s, high: 1"),
    ],
)
def test_only_finite_numbers(number, place, numbers):
    text = vary(f"parameter: simulator.plant.length, {numbers % number}")
    with pytest.raises(StudyError) as caught:
        parse_study(text, "study.yaml")
    assert str(caught.value) == (
        f"study.yaml: vary.v.{place}: is {float(number.replace('.', ''))}: a finite number is needed"
    )


@pytest.mark.parametrize(("text", "line"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes(text, line):
    with pytest.raises(StudyError) as caught:
        make_bases(parse_study(text, "study.yaml"))
    message = str(caught.value)
    assert message.startswith("study.yaml: ")
    assert line in message
    assert "\n" not in message


def test_no_such_study():
    with pytest.raises(
        StudyError,
        match=r"no study 'nix': there is no such file: give one, or one of actuator, delay_gain",
    ):
        read_study("nix")


def test_exponents_without_a_dot_are_numbers():
    text = vary("parameter: simulator.sensor.delay, values: [1e-3, 0.002]")
    assert parse_study(text, "s").variables[0].values == (0.001, 0.002)


def test_comments_are_not_content():
    def content(text, source):
        study = parse_study(text, source)
        return identity(study, make_bases(study))

    one = content(HEAD + DELAY, "a.yaml")
    assert one == content("# a comment\n" + HEAD + DELAY, "b.yaml")
    assert one != content(HEAD + DELAY.replace("0.0", "0.1"), "a.yaml")
    assert one != content(HEAD + "duration: 3.0\n" + DELAY, "a.yaml")


@pytest.mark.parametrize(
    "drawn",
    [
        Distribution("uniform", low=-1.0, high=3.0),
        Distribution("loguniform", low=0.1, high=10.0),
        Distribution("normal", mean=1.0, std=2.0, low=-1.0, high=3.0),
        Distribution("integers", low=2, high=5),
        Distribution("choice", ("a", "b")),
    ],
    ids=lambda d: d.kind,
)
def test_draws(drawn):
    values = drawn.draw(4000, 3, "x")
    assert values[:100] == drawn.draw(100, 3, "x")
    assert values[:100] != drawn.draw(100, 4, "x")
    assert values[:100] != drawn.draw(100, 3, "y")
    if drawn.kind == "choice":
        assert set(values) == {"a", "b"}
        return
    low, high = np.min(values), np.max(values)
    assert drawn.low <= low <= high <= drawn.high
    middle = np.sqrt(drawn.low * drawn.high) if drawn.kind == "loguniform" else 1.0
    middle = 3.5 if drawn.kind == "integers" else middle
    share = np.mean(np.array(values) < middle)
    assert 0.46 < share < 0.54
