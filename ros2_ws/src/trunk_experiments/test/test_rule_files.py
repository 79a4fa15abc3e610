"""Rule files of others: read as their formats say, taken over as tables, written for other programs."""

import random
import re
import shutil
import subprocess
from math import exp
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.fuzzy_torque import FuzzyConfig
from trunk_control.rulebase import sampling
from trunk_control.rulebase.exporting import written
from trunk_control.rulebase.fcl import fcl_to_fll
from trunk_control.rulebase.fis import fis_to_fll
from trunk_control.rulebase.importing import fraction, import_rules
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import build, values_of
from trunk_experiments.cli import trunk

from .documents import checked

SOURCES = Path(__file__).parents[2]


@pytest.fixture
def engine():
    """Return what reads a text of FLL."""
    pytest.importorskip("fuzzylite", reason="needs pyfuzzylite: requirements/fuzzy.txt")
    from trunk_control.rulebase.inference import RuleEngine

    return lambda fll, both_ends=False: RuleEngine(fll, Path("rules"), both_ends)


def fis(inputs, outputs, rules, **system):
    """Return a .fis: membership functions by variable, rules, and what of [System] is not usual."""
    usual = {"Type": "mamdani", "AndMethod": "min", "OrMethod": "max", "ImpMethod": "min"}
    usual |= {"AggMethod": "max", "DefuzzMethod": "centroid"} | system
    lines = ["% a comment", "[System]", "Name='a'", "Version=2.0", f"NumRules={len(rules)}"]
    lines += [f"NumInputs={len(inputs)}", f"NumOutputs={len(outputs)}"]
    lines += [f"{key}='{value}'" for key, value in usual.items()]
    for kind, variables in (("Input", inputs), ("Output", outputs)):
        for k, (name, (low, high, *terms)) in enumerate(variables.items(), 1):
            lines += [f"[{kind}{k}]", f"Name='{name}'", f"Range=[{low} {high}]"]
            lines += [f"NumMFs={len(terms)}"]
            lines += [
                f"MF{i}='m{i}':'{shape}',{numbers}" for i, (shape, numbers) in enumerate(terms, 1)
            ]
    return "\n".join([*lines, "[Rules]", *rules]) + "\n"


SUGENO = {"Type": "sugeno", "AndMethod": "prod", "DefuzzMethod": "wtaver"}
ONE = {"x": (-2, 2, ("trimf", "[-2 0 2]"), ("gaussmf", "[0.7 0.5]"))}
Y = {"y": (0, 10, ("trimf", "[0 2 6]"), ("trapmf", "[3 6 8 10]"))}


def logistic(a, c):
    return lambda x: 1.0 / (1.0 + exp(-a * (x - c)))


def s_curve(a, b):
    middle = (a + b) / 2.0

    def value(x):
        if x <= a:
            return 0.0
        if x >= b:
            return 1.0
        return 2 * ((x - a) / (b - a)) ** 2 if x <= middle else 1 - 2 * ((x - b) / (b - a)) ** 2

    return value


# As MATLAB's manual defines them.
CURVES = {
    "trimf [-1 0.5 2]": lambda x: max(min((x + 1) / 1.5, (2 - x) / 1.5), 0),
    "trapmf [-1 0 1 1.5]": lambda x: max(min(x + 1, 1, (1.5 - x) / 0.5), 0),
    "gaussmf [0.5 -0.2]": lambda x: exp(-((x + 0.2) ** 2) / (2 * 0.25)),
    "gbellmf [0.8 3 0.1]": lambda x: 1 / (1 + abs((x - 0.1) / 0.8) ** 6),
    "sigmf [3 0.2]": logistic(3, 0.2),
    "dsigmf [5 -1 4 1]": lambda x: logistic(5, -1)(x) - logistic(4, 1)(x),
    "psigmf [5 -1 -4 1]": lambda x: logistic(5, -1)(x) * logistic(-4, 1)(x),
    "smf [-1 1.5]": s_curve(-1, 1.5),
    "zmf [-1 1.5]": lambda x: 1 - s_curve(-1, 1.5)(x),
    "pimf [-1.5 -0.5 0.5 1.7]": lambda x: s_curve(-1.5, -0.5)(x) * (1 - s_curve(0.5, 1.7)(x)),
    "gauss2mf [0.5 -0.3 0.8 0.4]": lambda x: (
        (exp(-((x + 0.3) ** 2) / 0.5) if x < -0.3 else 1.0)
        * (exp(-((x - 0.4) ** 2) / 1.28) if x > 0.4 else 1.0)
    ),
}  # fmt: skip


def test_membership_functions_are_those_of_the_manual(engine):
    x = np.linspace(-2.0, 2.0, 81)
    for text, curve in CURVES.items():
        shape, _, numbers = text.partition(" ")
        inputs = {"x": (-2, 2, (shape, numbers))}
        # Weighted averages of 1 where it fires and 0 where it does not are the membership.
        outputs = {"y": (0, 1, ("constant", "[1]"), ("constant", "[0]"))}
        file = fis(inputs, outputs, ["1, 1 (1) : 1", "-1, 2 (1) : 1"], **SUGENO)
        (y,) = engine(fis_to_fll(file)).evaluate({"x": x}, ["y"])
        assert y == pytest.approx([curve(v) for v in x.tolist()], abs=1e-12), text


POINTS = np.linspace(0.0, 10.0, 101)


def areas(y):
    """Return the two output functions of `Y` at points."""
    first = np.minimum(y / 2, (6 - y) / 4)
    second = np.minimum((y - 3) / 3, np.minimum(1, (10 - y) / 2))
    return np.clip(first, 0, 1), np.clip(second, 0, 1)


@pytest.mark.parametrize(
    ("imp", "agg", "implied", "united"),
    [
        ("min", "max", np.minimum, np.maximum),
        ("prod", "probor", np.multiply, lambda a, b: a + b - a * b),
        ("prod", "sum", np.multiply, np.add),
    ],
)
def test_mamdani_is_what_its_definition_gives(engine, imp, agg, implied, united):
    rules = ["1, 1 (1) : 1", "-2, 2 (0.5) : 1"]
    at = np.linspace(-1.9, 1.9, 21)
    text = fis_to_fll(fis(ONE, Y, rules, ImpMethod=imp, AggMethod=agg))
    (y,) = engine(text, both_ends=True).evaluate({"x": at}, ["y"])
    for x, value in zip(at.tolist(), y.tolist(), strict=True):
        weights = 1 - abs(x) / 2, 0.5 * (1 - exp(-((x - 0.5) ** 2) / 0.98))
        first, second = (implied(w, a) for w, a in zip(weights, areas(POINTS), strict=True))
        shape = united(first, second)
        assert value == pytest.approx((shape * POINTS).sum() / shape.sum(), rel=1e-12)


FCL = """\
FUNCTION_BLOCK a (* the same as the .fis *)
VAR_INPUT x : REAL; END_VAR
VAR_OUTPUT y : REAL; END_VAR
FUZZIFY x
  TERM m1 := (-2, 0) (0, 1) (2, 0); // a comment
  TERM m2 := gauss 0.5 0.7;
  RANGE := (-2 .. 2);
END_FUZZIFY
DEFUZZIFY y
  RANGE := (0 .. 10);
  TERM m1 := Triangle 0 2 6;
  TERM m2 := (3, 0) (6, 1) (8, 1) (10, 0);
  METHOD : COG;  DEFAULT := NC;
END_DEFUZZIFY
RULEBLOCK one
  AND : MIN;  ACT : MIN;  ACCU : MAX;
  RULE 1 : IF x IS m1 AND (x IS NOT m2 OR x IS m2) THEN y IS m1;
  RULE 2 : IF NOT x IS m2 THEN y IS m2 WITH 0.5;
END_RULEBLOCK
END_FUNCTION_BLOCK
"""


def test_the_formats_say_the_same(engine):
    x = np.linspace(-1.9, 1.9, 50)
    same = fis(ONE, Y, ["1, 1 (1) : 1", "-2, 2 (0.5) : 1"])
    of_fcl = FCL.replace(" AND (x IS NOT m2 OR x IS m2)", "")
    of_fis = fis_to_fll(same).replace("Centroid 101", "Centroid 100")
    values = [
        engine(text).evaluate({"x": x}, ["y"])
        for text in (of_fis, fcl_to_fll(of_fcl), fcl_to_fll(of_fcl.replace("m2 WITH", "m2  WITH")))
    ]  # fmt: skip
    assert np.array_equal(values[1], values[2])
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    nested = engine(fcl_to_fll(FCL)).evaluate({"x": x}, ["y"])
    assert not np.allclose(nested, values[1])  # the parentheses are read


def random_config(seed, rows, columns):
    draw = random.Random(seed)

    def peaks(count):
        return tuple(sorted(draw.uniform(-1.0, 1.0) for _ in range(count)))

    def table(labels, low, high):
        cells = [*labels, *(repr(draw.uniform(low, high)) for _ in range(3))]
        return tuple(" ".join(draw.choice(cells) for _ in range(columns)) for _ in range(rows))

    return build(
        FuzzyPidConfig,
        {
            **values_of(FuzzyPidConfig()),
            "fuzzy.error_range": draw.uniform(0.1, 3.0),
            "fuzzy.rate_range": draw.uniform(0.1, 30.0),
            "fuzzy.error_peaks": peaks(rows),
            "fuzzy.rate_peaks": peaks(columns),
            "rules.kp": table("SB", 0.0, 1.0),
            "rules.kd": table("SB", 0.0, 1.0),
            "rules.alpha": table(("S", "MS", "M", "B"), 0.1, 9.0),
        },
    )


CONFIGS = {
    "default": FuzzyPidConfig(),
    "torque": FuzzyConfig(),
    "2 x 9": random_config(1, 2, 9),
    "12 x 5": random_config(2, 12, 5),
}


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
@pytest.mark.parametrize("suffix", [".fis", ".fll"])
def test_exported_rules_come_back_bit_for_bit(engine, tmp_path, config, suffix):
    file = tmp_path / f"rules{suffix}"
    file.write_text(written(config, suffix))
    back = import_rules(file, {}, {}, 1e-9)
    assert back.exact
    assert back.deviation.share < 1e-12
    kind = type(config)
    again = build(kind, {**values_of(kind()), **back.values})
    assert again.rules == config.rules  # peaks and tables
    assert again == config or config != kind()
    assert written(again, suffix) == file.read_text()


@pytest.mark.skipif(
    shutil.which("fuzzylite") is None, reason="needs the program: apt install fuzzylite"
)
@pytest.mark.parametrize("suffix", [".fis", ".fll"])
def test_another_program_computes_our_numbers(tmp_path, suffix):
    config = CONFIGS["12 x 5"]
    rules, points, out = (tmp_path / name for name in (f"rules{suffix}", "at.fld", "out.fld"))
    rules.write_text(written(config, suffix))
    ranges = config.error_range, config.rate_range
    at = np.random.default_rng(3).uniform(-1, 1, (2000, 2)) * ranges
    np.savetxt(points, at, fmt="%.17g")
    options = ["-decimals", "17", "-dheader", "false", "-dinputs", "false", "-if", suffix[1:]]
    subprocess.run(
        ["fuzzylite", "-i", rules, "-o", out, "-of", "fld", "-d", points, *options],
        check=True,
        capture_output=True,
    )
    ours = np.array([config.inference(e, r) for e, r in at.tolist()])
    assert np.genfromtxt(out) == pytest.approx(ours, rel=1e-12, abs=1e-12)


def test_what_others_cannot_compute_is_refused():
    logarithmic = build(FuzzyPidConfig, {**values_of(FuzzyPidConfig()), "fuzzy.consequents": "log"})
    with pytest.raises(PlanError, match=r"fuzzy\.consequents: 'log'"):
        written(logarithmic, ".fis")
    label = {"fuzzy.kp_labels": ("S+", "B"), "rules.kp": ("B " * 7,) * 7}
    with pytest.raises(PlanError, match=r"label 'S\+'"):
        written(build(FuzzyPidConfig, {**values_of(FuzzyPidConfig()), **label}), ".fll")


def test_a_share_gives_back_its_number():
    draw = random.Random(4)
    for _ in range(2000):
        whole, share = (
            draw.uniform(1e-3, 1e3),
            draw.choice((1 / 3, 0.7, 2 / 3, draw.uniform(-1, 1))),
        )
        assert fraction(whole * share, whole) * whole == whole * share
    assert fraction(np.pi / 2 * (1 / 3), np.pi / 2) == 1 / 3
    assert fraction(0.0, 5.0) == 0.0


def test_a_smooth_surface_is_sampled_as_closely_as_asked():
    def surface(e, r):
        return np.array([np.tanh(3 * e) + 0.2 * r * r, np.sin(e * r)])

    ranges = [(-1.0, 1.0), (-2.0, 2.0)]
    points = sampling.check_points(surface, ranges, 20_000)
    sizes = []
    for tolerance in (0.1, 0.01, 0.003):
        sampled = sampling.sample(surface, points, ranges, [[], []], tolerance)
        distance = np.abs(sampled.table.at(points.error, points.rate) - points.values).max(axis=1)
        assert sampled.deviation.share == pytest.approx(max(distance / points.span))
        assert sampled.deviation.share <= tolerance
        assert not sampled.exact
        sizes.append(sampled.table.values[0].size)
    assert sizes == sorted(sizes)
    assert sizes[0] < 100 < sizes[-1] < 64 * 64


def test_a_table_is_found_again_between_its_peaks():
    rng = np.random.default_rng(5)
    e, r = np.sort(rng.uniform(-1, 1, 6)), np.sort(rng.uniform(-3, 3, 4))
    table = sampling.Table(e, r, rng.normal(size=(2, 6, 4)))
    ranges = [(-1.5, 1.2), (-4.0, 3.0)]
    points = sampling.check_points(table.at, ranges, 5000)
    again = sampling.sample(table.at, points, ranges, [e.tolist(), r.tolist()], 0.01)
    assert again.exact
    assert again.deviation.distance < 1e-15
    assert again.table.values == pytest.approx(table.values, abs=1e-15)


def said(*words):
    done = CliRunner().invoke(trunk, [str(word) for word in words])
    return done, str(done.exception or "")


def test_a_jump_is_refused_and_nothing_is_written(engine, tmp_path):
    steps = {"x": (-2, 2, ("rectmf", "[-3 0.123]"), ("rectmf", "[0.123 3]"))}
    file = tmp_path / "jump.fis"
    levels = {"u": (0, 1, ("constant", "[0.2]"), ("constant", "[0.9]"))}
    file.write_text(fis(steps, levels, ["1, 1 (1) : 1", "2, 2 (1) : 1"], **SUGENO))
    gives = ("--output-variable", "kp=u", "--output-variable", "kd=0.5")
    words = ("rules", "read", file, "--input", "e=x", *gives)
    target = tmp_path / "out.yaml"
    done, error = said(*words, "--output-variable", "alpha=3", "-o", target)
    assert done.exit_code != 0
    assert "64 x 64 peaks come no closer" in error
    assert not target.exists()
    raised = re.search(r"--tolerance (\S+) takes", error)[1]
    done, _ = said(*words, "--output-variable", "alpha=3", "-o", target, "--tolerance", raised)
    assert done.exit_code == 0
    assert "greatest deviation" in done.output


def test_the_verbs_say_what_they_wrote(engine, tmp_path):
    rules, target, picture = (tmp_path / name for name in ("r.fll", "r.yaml", "r.png"))
    done, _ = said("rules", "write", "-o", rules, "--json")
    assert checked(done.output, "rules-write-1")["outputs"] == ["kp", "kd", "alpha"]
    done, _ = said("rules", "read", rules, "-o", target, "--picture", picture, "--json")
    document = checked(done.output, "rules-read-1")
    assert document["exact"]
    assert document["peaks"] == {"error": 7, "rate": 7}
    assert picture.read_bytes().startswith(b"\x89PNG")
    again, first = tmp_path / "again.yaml", target.read_text()
    said("rules", "write", "--params", target, "-o", rules, "--force")
    said("rules", "read", rules, "-o", again)
    assert again.read_text() == first


def test_one_module_imports_the_library():
    """It is under the GPL: the rest of the project must not depend on it."""
    users = {
        path.name
        for path in SOURCES.glob("*/trunk_*/**/*.py")
        if re.search(r"(import|import_module\(.)\s*\"?fuzzylite", path.read_text())
    }
    assert users == {"inference.py"}
