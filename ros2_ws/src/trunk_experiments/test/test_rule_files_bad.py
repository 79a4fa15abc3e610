"""Rule files that are cut, wrong, hostile or not rule files: one line each, and nothing is written."""

import sys

import pytest
from click.testing import CliRunner

from trunk_core.errors import TrunkError
from trunk_experiments.cli import trunk

from .rule_texts import FCL, FIS, FLL

# Its term S is a formula.
FUNCTION = (
    FLL.replace("Triangle 0 1 3.5", "Function {}")
    .replace("Triangle 1.5 4 5", "Constant 1")
    .replace("Centroid 100", "WeightedAverage")
    .replace("aggregation: Maximum", "")
)
GAPLESS = FUNCTION.replace("  default: 3\n", "").replace("-2 -1 -0.2", "-2 -1 1")
MILLION = 1_000_000


def cut(text, share):
    return text[: int(share * len(text))]


def changed(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


BAD = {
    **{f"cut at {share}.fis": cut(FIS, share) for share in (0.02, 0.2, 0.45, 0.6, 0.8, 0.97)},
    **{f"cut at {share}.fll": cut(FLL, share) for share in (0.05, 0.3, 0.5)},
    **{f"cut at {share}.fcl": cut(FCL, share) for share in (0.1, 0.3, 0.6, 0.9)},
    "fewer rules.fis": changed(FIS, "NumRules=3", "NumRules=4"),
    "fewer functions.fis": changed(FIS, "NumMFs=2", "NumMFs=3"),
    "fewer inputs.fis": changed(FIS, "NumInputs=2", "NumInputs=3"),
    "count.fis": changed(FIS, "NumRules=3", "NumRules=3.5"),
    "huge count.fis": changed(FIS, "NumInputs=2", "NumInputs=1e300"),
    "fewer numbers.fis": changed(FIS, "[-2 -1 -0.2]", "[-2 -1]"),
    "number.fis": changed(FIS, "[-2 -1 -0.2]", "[-2 x -0.2]"),
    "nan.fis": changed(FIS, "[-2 -1 -0.2]", "[-2 NaN -0.2]"),
    "nan range.fis": changed(FIS, "Range=[-1 1]", "Range=[-1 nan]"),
    "endless range.fis": changed(FIS, "Range=[-1 1]", "Range=[-1 inf]"),
    "range.fis": changed(FIS, "Range=[-1 1]", "Range=[1 -1]"),
    "method.fis": changed(FIS, "'centroid'", "'__import__'"),
    "type.fis": changed(FIS, "'mamdani'", "'type3'"),
    "shape.fis": changed(FIS, "'trimf'", "'mymf'"),
    "index.fis": changed(FIS, "1 1, 1 (1)", "1 3, 1 (1)"),
    "fraction.fis": changed(FIS, "1 1, 1 (1)", "1.5 1, 1 (1)"),
    "endless index.fis": changed(FIS, "1 1, 1 (1)", "inf 1, 1 (1)"),
    "weight.fis": changed(FIS, "1 1, 1 (1)", "1 1, 1 (2)"),
    "connective.fis": changed(FIS, "(1) : 1", "(1) : 3"),
    "negated output.fis": changed(FIS, "1 1, 1 (1)", "1 1, -1 (1)"),
    "empty rule.fis": changed(FIS, "1 1, 1 (1)", "0 0, 1 (1)"),
    "twice.fis": FIS + "[Output1]\n",
    "no rule fires.fis": changed(FIS, "Default=3\n", ""),
    "million.fis": changed(FIS, "NumRules=3", f"NumRules={MILLION + 3}") + "1 1, 1 (1) : 1\n" * MILLION,
    "many.fll": FLL + "  rule: if e is N then u is S\n" * 30_000,
    "wide.fis": FIS.encode("utf-16"),
    "zeros.fis": FIS + "\0" * 10,
    "picture.fis": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
    "empty.fis": "",
    "cyclic.fll": GAPLESS.format("u + 1"),
    "recursive.fll": FUNCTION.format("S + 1"),
    "nested.fll": FUNCTION.format("(" * 5000 + "1"),
    "code.fll": FUNCTION.format("__import__('os').system('touch touched')"),
    "word.fll": FLL + "surprise: 1\n",
    "twice.fll": changed(FLL, "term: P Triangle", "term: N Triangle"),
    "activation.fll": changed(FLL, "activation: General", "activation: First 1 0.5"),
    "resolution.fll": changed(FLL, "Centroid 100", "Centroid 1010000000"),
    "no method.fll": changed(FLL, "  defuzzifier: Centroid 100\n", ""),
    "no term.fll": changed(FLL, "u is S", "u is XXL"),
    "nan.fll": changed(FLL, "Triangle -2 -1 -0.2", "Triangle -2 nan -0.2"),
    "method.fcl": changed(FCL, "COG", "COGX"),
    "points.fcl": changed(FCL, "(-1, 1) (-0.2, 0)", "(-0.2, 1) (-1, 0)"),
    "group.fcl": changed(FCL, "IF e IS N AND e_dot IS N", "IF NOT (e IS N AND e_dot IS N)"),
    "no term.fcl": changed(FCL, "TERM S := (0, 0) (1, 1) (3.5, 0);", ""),
    "notes.txt": FIS,
}  # fmt: skip
WORDS = ("--output-variable", "kd=0.5", "--output-variable", "alpha=3", "--tolerance", 1)


def imported(file, *words):
    words = ("rules", "read", file, "--output-variable", "kp=u", *WORDS, *words)
    return CliRunner().invoke(trunk, [str(word) for word in words])


@pytest.fixture(autouse=True)
def _library():
    pytest.importorskip("fuzzylite", reason="needs pyfuzzylite: requirements/fuzzy.txt")


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_gives_one_line_and_writes_nothing(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / name
    content = BAD[name]
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    done = imported(file, "-o", "out.yaml", "--picture", "out.png")
    assert done.exit_code != 0
    assert isinstance(done.exception, TrunkError), (done.exception, done.output)
    text = str(done.exception)
    assert name in text
    assert "\n" not in text
    assert 0 < len(text) < 400
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("suffix", "encoding"), [("fis", "latin-1"), ("fll", "utf-8-sig"), ("fcl", "utf-8")]
)
def test_a_sound_file_is_read_whatever_its_encoding(tmp_path, suffix, encoding):
    text = {"fis": FIS, "fll": FLL, "fcl": FCL}[suffix].replace("gap", "Höhe")
    file = tmp_path / f"rules.{suffix}"
    file.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    done = imported(file, "-o", tmp_path / "out.yaml")
    assert done.exit_code == 0, done.exception


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--input", "e=nix"), "no input 'nix': it has e, e_dot"),
        (("--input", "e=e", "--input", "e_dot=e"), "say which is e and which e_dot"),
        (("--input", "x=e"), "--input 'x=e': give e=NAME"),
        (("--input", "e=e", "--input", "ė=e"), "say which is e and which e_dot"),
        (("--output-variable", "kp=nix"), "--output-variable 'kp=nix': give u=NAME"),
        (("--output-variable", "u=u"), "say what they are: --output-variable u=NAME"),
    ],
)
def test_wrong_names_are_named(tmp_path, words, says):
    file = tmp_path / "sound.fis"
    file.write_text(FIS)
    done = imported(file, "-o", tmp_path / "out.yaml", *words)
    assert done.exit_code != 0
    assert says in str(done.exception)
    assert not (tmp_path / "out.yaml").exists()


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fuzzylite", None)
    file = tmp_path / "sound.fis"
    file.write_text(FIS)
    done = imported(file, "-o", tmp_path / "out.yaml")
    assert done.exit_code != 0
    assert "pip install --no-deps pyfuzzylite" in str(done.exception)
