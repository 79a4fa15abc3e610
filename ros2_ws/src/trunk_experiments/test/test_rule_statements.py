"""Each statement of each grammar changes the table, or is refused by its name; shapes, names, lines."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_control.rulebase.fis import _SWITCHES, _SYSTEM
from trunk_control.rulebase.importing import _KEYS, import_rules
from trunk_core.errors import RuleFileError
from trunk_experiments.cli import trunk

from .rule_texts import FCL, FIS, FLL

BASE = {".fis": FIS, ".fll": FLL, ".fcl": FCL}
SAYS_NOTHING = {"Name", "Version", "Engine", "description"}
# Old and new text.
CHANGES = {
    ".fis": [
        *(("Type='mamdani'", "Type='sugeno'"), ("NumInputs=2", "NumInputs=1")),
        *(("NumOutputs=1", "NumOutputs=2"), ("NumRules=3", "NumRules=2")),
        *(("AndMethod='min'", "AndMethod='prod'"), ("OrMethod='max'", "OrMethod='probor'")),
        *(("ImpMethod='min'", "ImpMethod='prod'"), ("AggMethod='max'", "AggMethod='probor'")),
        *(("DefuzzMethod='centroid'", "DefuzzMethod='mom'"), ("Name='u'", "Name='v'")),
        *(("Enabled=1\nRange=[-1", "Enabled=0\nRange=[-1"), ("Enabled=1\nDef", "Enabled=0\nDef")),
        *(("Default=3", "Default=2"), ("LockPrevious=0", "LockPrevious=1")),
        *(("LockRange=0", "LockRange=2"), ("Range=[-1 1]", "Range=[-1.5 1]")),
        *(("Range=[0 5]", "Range=[0 4]"), ("NumMFs=2", "NumMFs=1")),
        *(("'trimf',[0.2 1 2]", "'trimf',[0.2 0.7 2]"), ("(0.5) : 2", "(0.6) : 2")),
        *(("(0.5) : 2", "(0.5) : 1"), ("[Rules]", "[More]\nx=1\n[Rules]")),
        *(("NumInputs=2", "TypeRedMethod='km'\nNumInputs=2"), ("Range=[0 5]", "Unit='N m'\nRange=[0 5]")),
        *(("Default=3", "Default=3\nDefault=4"),),
    ],
    ".fll": [
        *(("enabled: true\n  range: -1", "enabled: false\n  range: -1"), ("range: 0 5", "range: 0 4")),
        *(("enabled: true\n  range: 0", "enabled: false\n  range: 0"), ("range: -1 1", "range: -1.5 1")),
        *(("enabled: true\n  conj", "enabled: false\n  conj"), ("default: 3", "default: 2")),
        ("lock-previous: false", "lock-previous: true"),
        ("aggregation: Maximum", "aggregation: BoundedSum"),
        ("defuzzifier: Centroid 100", "defuzzifier: MeanOfMaximum 100"),
        ("term: P Triangle 0.2", "term: P Triangle 0.1"),
        ("conjunction: Minimum", "conjunction: AlgebraicProduct"),
        ("disjunction: Maximum", "disjunction: AlgebraicSum"),
        ("implication: Minimum", "implication: AlgebraicProduct"),
        ("activation: General", "activation: Highest 1"),
        *(("with 0.5", "with 0.6"), ("default: 3", "default: 3\n  default: 4")),
        *(("Engine: gap", "rule: if e is N then u is S\nEngine: gap"), ("RuleBlock:", "RuleBlok:")),
        *(("InputVariable: e\n", "InputVariable: f\n"), ("OutputVariable: u", "OutputVariable: v")),
    ],
    ".fcl": [
        *(("ENABLED : TRUE; TERM", "ENABLED : FALSE; TERM"), ("ENABLED : TRUE;\n", "ENABLED : FALSE;\n")),
        *(("LOCK : ;", "ENABLED : FALSE;"), ("LOCK : ;", "LOCK : PREVIOUS;"), ("LOCK : ;", "LOCK : X;")),
        ("DEFAULT := 3", "DEFAULT := 2"),
        ("DEFAULT := 3", "DEFAULT := NC"),
        ("DEFAULT := 3", "DEFAULT := 3 | NC"),
        *(("ACCU : MAX", "ACCU : BSUM"), ("RULEBLOCK r", "RULEBLOCK r ACCU : ASUM;")),
        *(("METHOD : COG", "METHOD : MM"), ("METHOD : COG;", "METHOD : COG; METHOD : MM;")),
        *(("RANGE := (-1 .. 1)", "RANGE := (-1.5 .. 1)"), ("RANGE := (0 .. 5)", "RANGE := (0 .. 4)")),
        *(("AND : MIN", "AND : PROD"), ("OR : MAX", "OR : ASUM"), ("ACT : MIN", "ACT : PROD")),
        ("ACTIVATION : General", "ACTIVATION : Highest"),
        ("WITH 0.5", "WITH 0.6"),
        ("LOCK : ;", "UNIT : N;"),
        *(("END_FUNCTION_BLOCK", "OPTION x; END_OPTION END_FUNCTION_BLOCK"), ("e : REAL;", "e : INT;")),
        *(("END_FUZZIFY\nDEF", "END_FUZZIFY FUZZIFY f END_FUZZIFY\nDEF"), ("(0.2, 0)", "(0.3, 0)")),
    ],
}  # fmt: skip


@pytest.fixture(autouse=True)
def _library():
    pytest.importorskip("fuzzylite", reason="needs pyfuzzylite: requirements/fuzzy.txt")


@pytest.fixture
def taken_over(tmp_path):
    """Return a function that gives the table of a text, or else the line that refuses it."""

    def go(suffix, text, tolerance=1.0):
        path = tmp_path / f"rules{suffix}"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        e, r = (
            points.ravel() for points in np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-2, 2, 41))
        )
        try:
            taken = import_rules(path, {}, {"u": "u"}, tolerance)
            return taken.surface(e, r).tolist(), taken.values
        except RuleFileError as error:
            return str(error).removeprefix(f"{path}: ")

    return go


@pytest.mark.one_in(3)
@pytest.mark.parametrize("suffix", BASE)
def test_each_statement_counts_or_is_refused_by_name(taken_over, suffix):
    base = taken_over(suffix, BASE[suffix])
    assert not isinstance(base, str), base
    for old, new in CHANGES[suffix]:
        assert old in BASE[suffix], old
        found = taken_over(suffix, BASE[suffix].replace(old, new, 1))
        assert found != base, (old, new)
        if isinstance(found, str):
            words = {"input2", "output2"} if re.match("Num(In|Out)puts", old) else set()
            words |= {word.lower() for word in re.findall(r"\w+", f"{old} {new}")}
            assert words & set(re.findall(r"\w+", found.lower())), (new, found)


def test_no_statement_is_left_out():
    tried = {suffix: " ".join(old for old, _ in changes) for suffix, changes in CHANGES.items()}
    fis = {*_SYSTEM, *_SWITCHES} - SAYS_NOTHING
    fll = {f"{key}:" for key in set(_KEYS) - SAYS_NOTHING - {"rule", "lock-range"}}
    assert [key for key in fis if key not in tried[".fis"]] == []
    assert [key for key in fll if key not in tried[".fll"]] == []


def test_an_output_is_cut_at_its_range_where_the_file_says_so(taken_over):
    beyond = FLL.replace("Centroid 100", "WeightedAverage").replace(
        "Triangle 0 1 3.5", "Constant -9"
    )
    beyond = beyond.replace("Triangle 1.5 4 5", "Constant 9").replace("aggregation: Maximum", "")
    free, _ = taken_over(".fll", beyond)
    cut, _ = taken_over(".fll", beyond.replace("lock-range: false", "lock-range: true"))
    assert cut == np.clip(free, 0.0, 5.0).tolist() != free


def test_the_standard_accumulates_in_the_block_of_rules(taken_over):
    of_output = taken_over(".fcl", FCL.replace("ACCU : MAX", "ACCU : BSUM"))
    of_rules = FCL.replace("ACCU : MAX;", "").replace("ACT : MIN;", "ACT : MIN; ACCU : BSUM;")
    assert taken_over(".fcl", of_rules) == of_output != taken_over(".fcl", FCL)
    both = of_rules.replace("LOCK : ;", "ACCU : MAX;")
    assert "ACCU : MAX, but BSUM" in taken_over(".fcl", both)


@pytest.mark.one_in(4)
def test_keywords_of_any_case_and_lines_that_end_otherwise_say_the_same(taken_over):
    fcl = re.sub(r"\b[A-Z_]{2,}\b", lambda match: match[0].lower(), FCL).replace(
        "e : real; e_dot : real;", "e, e_dot : Real := 0.0;"
    )
    assert taken_over(".fcl", fcl) == taken_over(".fcl", FCL)
    assert taken_over(".fcl", FCL.replace("\n", "\r")) == taken_over(".fcl", FCL)
    for ends in ("\r", "\r\n", " "):
        assert taken_over(".fll", FLL.replace("\n", ends)) == taken_over(".fll", FLL)
    assert taken_over(".fis", FIS.replace("\n", "\r")) == taken_over(".fis", FIS)
    lost = taken_over(".fis", FIS.replace("\n", " "))
    assert lost.endswith("stands before the first section: not a .fis file")


@pytest.mark.parametrize(
    ("shape", "numbers", "says"),
    [
        ("trimf", "[1 0 -1]", "trimf 1 0 -1: give corners in ascending order"),
        ("trapmf", "[0 0.5 0.4 1]", "give corners in ascending order"),
        ("smf", "[0.5 0.5]", "give its start before its end"),
        ("zmf", "[1 0]", "give its start before its end"),
        ("pimf", "[-1 0.5 0 1]", "give two slopes in ascending order"),
        ("gaussmf", "[0 0.3]", "give a width that is not 0"),
        ("gauss2mf", "[0.1 0 0 0.5]", "give widths that are not 0"),
        ("gaussmf", "[0,5 0]", "gaussmf takes 2 numbers; there are 3"),
        ("trimf", "[-1,5 0 1]", "trimf takes 3 numbers; there are 4"),
    ],
)
def test_numbers_that_are_not_a_shapes_are_refused(taken_over, shape, numbers, says):
    found = taken_over(".fis", FIS.replace("'trimf',[0.2 1 2]", f"'{shape}',{numbers}"))
    assert found.startswith("[Input1] MF2: ")
    assert says in found


def test_zeros_that_fill_up_are_left_out(taken_over):
    filled = FIS.replace("[0.2 1 2]", "[0.2 1 2 0]").replace("[-6 -2 0]", "[-6, -2, 0, 0]")
    assert taken_over(".fis", filled) == taken_over(".fis", FIS)


def test_a_centroid_of_too_few_points_is_refused_with_its_term(taken_over):
    narrow = FIS.replace("[0 1 3.5]", "[0.96 1 1.04]")
    assert "u: its term S has 1 of the points of its centroid" in taken_over(".fis", narrow, 0.01)
    narrower = taken_over(".fis", FIS.replace("[0 1 3.5]", "[1.01 1.02 1.03]"), 0.01)
    assert "u: its term S has 0 of the points of its centroid" in narrower


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("error", "ec"), ()),
        (("de", "e"), ()),
        (("angle", "edot"), ()),
        (("angle", "speed"), ("--input", "e=angle")),
        (("angle", "speed"), ("--input", "ė=speed")),
        (("de", "x"), ("--input", "e=de")),
    ],
)
def test_usual_names_need_not_be_said(tmp_path, names, words):
    text = FIS.replace("Name='e_dot'", f"Name='{names[1]}'").replace(
        "Name='e'", f"Name='{names[0]}'"
    )
    file, target = tmp_path / "rules.fis", tmp_path / "rules.yaml"
    file.write_text(text)
    words = ["rules", "read", file, *words, "--tolerance", 1, "-o", target]
    done = CliRunner().invoke(trunk, [str(word) for word in words])
    assert done.exit_code == 0, done.exception
    turned = names == ("de", "e")
    assert f"error_range: {2.0 if turned else 1.0}" in target.read_text()


def test_a_term_that_is_always_zero_is_named(tmp_path):
    file, target = tmp_path / "rules.fis", tmp_path / "rules.yaml"
    file.write_text(FIS.replace("[-6 -2 0]", "[-6 -5 -4]"))
    words = ["rules", "read", file, "--tolerance", 1, "-o", target]
    done = CliRunner().invoke(trunk, [str(word) for word in words])
    assert "warning: e_dot: N is 0 over the whole range" in done.stderr
