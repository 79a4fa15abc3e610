"""A study's file: numbers, units, draws; a mistake gives one line: file, place, value, what is allowed.

``trunk sweep --check`` refuses what ``trunk sweep`` refuses, with the same message, before any run.
"""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_core.errors import StudyError
from trunk_experiments.cli import trunk
from trunk_studies.rows import identity, make_bases
from trunk_studies.study import Distribution, parse_study, read_study

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
    "unknown key": (HEAD + DELAY + "run: 3\n", "unknown key 'run': one of scenario"),
    "no scenario": ("controllers: [pid]\n" + DELAY, "scenario: missing"),
    "no controller": (HEAD.replace("pid", "pod") + DELAY, "controllers.pod: is 'pod': pid, fuzzy"),
    "no such scenario": (HEAD.replace("fig6", "fig5") + DELAY, "pid: no scenario 'fig5': give one"),
    "no such file": (HEAD + "params: nix\n" + DELAY, "pid: no parameter file 'nix'"),
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
    "a metric's name": (HEAD + DELAY.replace("delay:", "iae:"), "vary.iae: is not a column name"),
    "a controller twice": (
        HEAD.replace("pid", "pid, pid") + DELAY,
        "controllers: pid is there twice: give each a label, LABEL: {node: pid}",
    ),
    "a list of no names": (
        HEAD.replace("pid", "{pid: {}}") + DELAY,
        "controllers: is [{'pid': {}}]: a list of strings is needed",
    ),
    "integers beyond doubles": (
        vary("parameter: simulator.sensor.seed, distribution: integers, low: 1, high: 1.0e+300"),
        "vary.v: distribution integers: low 1 to high 1e+300: at most 2^53 either way",
    ),
    "mixed": (
        vary("parameter: simulator.hip.mode, values: [passive, 2]"),
        "all numbers, all strings or all bools are needed",
    ),
    "beyond all numbers": (
        vary("parameter: simulator.plant.length, from: 1e999, to: 1, steps: 2"),
        "vary.v.from: is '1e999': a finite number is needed",
    ),
    "no end": (HEAD + "set: {simulator.duration: 0.0}\n" + DELAY, "duration is 0"),
}


@pytest.mark.parametrize("number", ["inf", "-inf", ".inf", ".nan"])
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
        match=r"no study 'nix': there is no such file: give one, or one of actuator, basin, delay_gain",
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


UNITS = """
scenario: fig8
rate: 0.5 kHz
duration: 500 ms
controllers: [pid, fuzzy_pid]
set: {disturbance.pulse.duration: 100 ms}
vary:
"""
TIME = "  delay: {parameter: simulator.sensor.delay, %s}\n"
SIZE = "  size: {parameter: disturbance.pulse.magnitude, values: [50 N]}\n"


def study_of(entry):
    study = parse_study(UNITS + entry, "study.yaml")
    return study, make_bases(study)


def test_rate_duration_and_settings_take_units():
    study, bases = study_of(TIME % "values: [0.0]")
    assert (study.rate, study.duration) == (500.0, 0.5)
    assert all(base.disturbance.pulse_duration == 0.1 for base in bases.values())


@pytest.mark.parametrize(
    ("entry", "values"),
    [
        (TIME % "values: [0, 10 ms, 0.02]", (0, 0.01, 0.02)),
        (TIME % "from: 0 ms, to: 100 ms, steps: 3", (0.0, 0.05, 0.1)),
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
def test_a_grid_takes_units(entry, values):
    study, _ = study_of(entry)
    assert study.variables[0].values == values


def test_a_distribution_takes_units():
    study, _ = study_of(TIME % "distribution: normal, mean: 20 ms, std: 5ms, low: 0, high: 1e3 us")
    drawn = study.variables[0].distribution
    assert (drawn.mean, drawn.std, drawn.low, drawn.high) == (0.02, 0.005, 0.0, 0.001)
    study, _ = study_of(TIME % "distribution: choice, values: [1 ms, 0.002]")
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
    ("entry", "says"),
    [
        (TIME % "values: [5 kg]", "vary.delay.values: is '5 kg': it is a mass; a time in s"),
        (TIME % "from: 0, to: 5 m, steps: 2", "vary.delay.to: is '5 m': it is a length; a time"),
        (TIME % "as: factor, values: [5 ms]", "is '5 ms': it is a time; a plain number is needed"),
        (
            TIME % "distribution: uniform, low: 0 sec, high: 1",
            "vary.delay.low: is '0 sec': there is no unit 'sec'; a time in s",
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
def test_a_wrong_unit_names_file_entry_value_and_what_is_allowed(entry, says):
    with pytest.raises(StudyError) as caught:
        study_of(entry)
    assert str(caught.value).startswith("study.yaml: ")
    assert says in str(caught.value)


def test_how_a_number_is_written_does_not_change_the_study():
    """Blocks of an interrupted sweep stay usable."""
    with_units, plain = (
        identity(*study_of(TIME % f"values: [{values}]")) for values in ("0.0, 10 ms", "0.0, 0.01")
    )
    assert with_units == plain
    assert "written" not in json.dumps(plain["variables"])


SHORT = "scenario: fig6\nrate: 200\nduration: 0.5\ncontrollers: [pid]\n"
TWICE = "vary:\n  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.01]}\n"


def told(*arguments):
    """Return the exit code and the line that `trunk` ends with."""
    done = CliRunner().invoke(trunk, [str(argument) for argument in arguments])
    if done.exit_code == 0:
        return 0, done.output
    return done.exit_code, str(done.exception) if done.exit_code == 1 else done.output


REFUSED = {
    "references from nobody": (
        SHORT + "set: {pid.reference.profile: topic}\n" + TWICE,
        "pid: pid: reference.profile is 'topic', but nobody publishes references",
    ),
    "nobody's turn": (
        SHORT + "set: {pid.active.times: [0.1]}\n" + TWICE,
        "pid: active.times: no controller would act at t = 0 s",
    ),
    "a run without an end": (
        SHORT + "vary:\n  t: {parameter: simulator.duration, values: [0.5, 0.0]}\n",
        "vary.t: simulator.duration: duration is 0 s: a compiled run needs an end",
    ),
    "a run that fits no memory": (
        SHORT.replace("duration: 0.5", "duration: 1.0e+6") + TWICE,
        "pid: 200000001 states in a run: at most 20000000 are allowed",
    ),
    "a drawn run that fits no memory": (
        SHORT + "vary:\n  t: {parameter: simulator.duration, as: factor, values: [1.0, 1.0e+6]}\n",
        "vary.t: simulator.duration: 100000001 states in a run: at most",
    ),
}


@pytest.mark.parametrize(("text", "line"), REFUSED.values(), ids=REFUSED)
def test_check_and_sweep_give_the_same_error(tmp_path, text, line):
    study, output = tmp_path / "study.yaml", tmp_path / "out.parquet"
    study.write_text(text)
    checked = told("sweep", study, "-o", output, "--check")
    assert line in checked[1]
    assert checked[0] != 0
    assert told("sweep", study, "-o", output, "--jobs", 1) == checked
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


def test_check_notices_the_blocks_of_another_study(tmp_path):
    study, output = tmp_path / "study.yaml", tmp_path / "out.parquet"
    study.write_text(SHORT + TWICE)
    (tmp_path / "out.parquet.blocks").mkdir()
    (tmp_path / "out.parquet.blocks" / "sweep.json").write_text("{}")
    checked = told("sweep", study, "-o", output, "--check")
    assert "delete the folder, or give another -o" in checked[1]
    assert told("sweep", study, "-o", output, "--jobs", 1) == checked


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("none/out.parquet", "there is no folder"),
        ("out.csv", "the file's name must end in .parquet"),
        ("there.parquet", "exists: give another name, or --force"),
        ("study.yaml/out.parquet", "is not a folder"),
    ],
)
def test_an_impossible_output_is_refused_first(tmp_path, name, line):
    study = tmp_path / "study.yaml"
    study.write_text(SHORT + TWICE)
    (tmp_path / "there.parquet").write_text("mine")
    checked = told("sweep", study, "-o", tmp_path / name, "--check")
    assert line in checked[1]
    assert told("sweep", study, "-o", tmp_path / name) == checked
    assert (tmp_path / "there.parquet").read_text() == "mine"


def test_check_writes_nothing(tmp_path):
    study = tmp_path / "study.yaml"
    study.write_text(SHORT + TWICE)
    code, line = told("sweep", study, "-o", tmp_path / "out.parquet", "--check")
    assert (code, "2 runs in 1 blocks" in line) == (0, True)
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]


NOISE = "simulator:\n  ros__parameters:\n    sensor.position_noise: 0.01\n"


def test_noise_in_a_parameter_file_makes_runs_differ(tmp_path):
    (tmp_path / "mine.yaml").write_text(NOISE)
    text = SHORT + f"runs: 3\nparams: {tmp_path / 'mine.yaml'}\n" + TWICE
    assert make_bases(parse_study(text, "study.yaml"))


@pytest.mark.parametrize(
    "entry",
    [
        "vary:\n  v: {parameter: simulator.sensor.velocity_noise, values: [0.0, 0.1]}\n",
        "vary:\n  v: {parameter: disturbance.noise.rms, as: offset, values: [0.1]}\n",
    ],
)
def test_noise_that_varies_makes_runs_differ(entry):
    assert make_bases(parse_study(SHORT + "runs: 3\n" + entry, "study.yaml"))


@pytest.mark.parametrize(
    "text",
    [
        SHORT + "runs: 3\nset: {simulator.sensor.position_noise: 0.0}\n" + TWICE,
        SHORT + "runs: 3\nvary:\n  s: {parameter: simulator.sensor.seed, values: [1, 2]}\n",
        SHORT
        + "runs: 3\nvary:\n  n: {parameter: disturbance.noise.rms, as: factor, values: [1.0, 2.0]}\n",
    ],
)
def test_repeats_without_noise_are_refused(text):
    with pytest.raises(StudyError, match="runs: is 3, but nothing is drawn and there is no noise"):
        make_bases(parse_study(text, "study.yaml"))
