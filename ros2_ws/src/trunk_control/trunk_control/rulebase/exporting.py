"""A law's rule base as text for other programs: fuzzylite's ``.fll``, MATLAB's and Octave's ``.fis``.

Takagi-Sugeno of order 0: triangles that sum to one, product, weighted average. Kp' and Kd' from 0 to 1,
alpha, or u in N m; inputs in rad and rad/s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from trunk_core.errors import PlanError

from .importing import INPUTS, as_evaluated
from .words import identifier

_FAR = 1e3  # universes: where .fis, which has no infinity, ends the outer triangles' shoulders


class _Variable(NamedTuple):
    """A variable's range, and the number of each label."""

    name: str
    low: float
    high: float
    numbers: Mapping[str, float]


class _RuleBase(NamedTuple):
    inputs: list[_Variable]
    outputs: list[_Variable]
    cells: list[list[list[str]]]  # a label for each output, row and column


def written(config: Any, suffix: str) -> str:
    """Return a law's rules as the text of a file. Raises PlanError for what other programs cannot compute."""
    return FORMATS[suffix](_rule_base(config))


def _rule_base(config: Any) -> _RuleBase:
    if getattr(config, "consequents", "linear") != "linear":
        raise PlanError(
            f"fuzzy.consequents: {config.consequents!r}: other programs have no consequents that change with "
            "the weight: only 'linear' can be exported"
        )
    table = as_evaluated(config)
    inputs = [
        _Variable(name, -reach, reach, dict(zip(map(_name, labels), peaks.tolist(), strict=True)))
        for name, reach, labels, peaks in zip(
            INPUTS, (config.error_range, config.rate_range), config.axes, table[:2], strict=True
        )
    ]
    outputs, cells = [], []
    for declared, layer in zip(config.tables, table.values.tolist(), strict=True):
        # A number in a cell becomes a label that no label of ours can be.
        scale = config.output_scale if declared.name == "u" else 1.0
        texts_used = {text for row in declared.cells for text in row}
        named = declared.centers if texts_used & set(declared.centers) else {}
        numbers = {_name(label): scale * center for label, center in named.items()}
        numbered: dict[float, str] = {}
        rows = []
        for texts, values in zip(declared.cells, layer, strict=True):
            row = []
            for text, value in zip(texts, values, strict=True):
                if text not in named:
                    text = numbered.setdefault(value, f"_{len(numbered) + 1}")
                    numbers[text] = value
                row.append(text)
            rows.append(row)
        low, high = _range(declared.name, scale, max(numbers.values()))
        outputs.append(_Variable(declared.name, low, high, numbers))
        cells.append(rows)
    return _RuleBase(inputs, outputs, cells)


def _range(name: str, scale: float, largest: float) -> tuple[float, float]:
    if name == "u":
        return -scale, scale
    return 0.0, (1.0 if name in ("kp", "kd") else largest)


def _name(label: str) -> str:
    if identifier(label) != label:
        raise PlanError(
            f"label {label!r}: other programs allow letters, digits and _, and none of their words"
        )
    return label


def _fll(base: _RuleBase) -> str:
    lines = ["Engine: trunk"]
    for variable in base.inputs:
        lines += [f"InputVariable: {variable.name}", "  enabled: true", _fll_range(variable)]
        lines.append("  lock-range: false")
        peaks = ["-inf", *map(repr, variable.numbers.values()), "inf"]
        lines += [
            f"  term: {label} Triangle {' '.join(peaks[k : k + 3])}"
            for k, label in enumerate(variable.numbers)
        ]
    for variable in base.outputs:
        lines += [f"OutputVariable: {variable.name}", "  enabled: true", _fll_range(variable)]
        lines += ["  lock-range: false", "  aggregation: none"]
        lines += ["  defuzzifier: WeightedAverage TakagiSugeno", "  default: nan"]
        lines.append("  lock-previous: false")
        lines += [
            f"  term: {label} Constant {value!r}" for label, value in variable.numbers.items()
        ]
    lines += ["RuleBlock: rules", "  enabled: true", "  conjunction: AlgebraicProduct"]
    lines += ["  disjunction: none", "  implication: none", "  activation: General"]
    for i, j, consequents in _rules(base):
        row, column = (list(v.numbers)[k] for v, k in zip(base.inputs, (i, j), strict=True))
        then = " and ".join(
            f"{v.name} is {label}" for v, label in zip(base.outputs, consequents, strict=True)
        )
        lines.append(f"  rule: if e is {row} and e_dot is {column} then {then}")
    return "\n".join(lines) + "\n"


def _fll_range(variable: _Variable) -> str:
    return f"  range: {variable.low!r} {variable.high!r}"


def _fis(base: _RuleBase) -> str:
    rules = list(_rules(base))
    lines = ["[System]", "Name='trunk'", "Type='sugeno'", "Version=2.0"]
    lines += [f"NumInputs={len(base.inputs)}", f"NumOutputs={len(base.outputs)}"]
    lines += [f"NumRules={len(rules)}", "AndMethod='prod'", "OrMethod='probor'"]
    lines += ["ImpMethod='prod'", "AggMethod='sum'", "DefuzzMethod='wtaver'"]
    for number, variable in enumerate(base.inputs, 1):
        peaks = list(variable.numbers.values())
        far = _FAR * variable.high
        left, right = (
            f"[{-far!r} {-far!r} {peaks[0]!r} {peaks[1]!r}]",
            f"[{peaks[-2]!r} {peaks[-1]!r} {far!r} {far!r}]",
        )
        shapes = [f"'trapmf',{left}"]
        shapes += [
            f"'trimf',[{' '.join(map(repr, peaks[k : k + 3]))}]" for k in range(len(peaks) - 2)
        ]
        lines += _fis_variable(f"Input{number}", variable, [*shapes, f"'trapmf',{right}"])
    for number, variable in enumerate(base.outputs, 1):
        constants = [f"'constant',[{value!r}]" for value in variable.numbers.values()]
        lines += _fis_variable(f"Output{number}", variable, constants)
    lines += ["", "[Rules]"]
    index = [{label: k for k, label in enumerate(v.numbers, 1)} for v in base.outputs]
    for i, j, consequents in rules:
        then = " ".join(str(known[label]) for known, label in zip(index, consequents, strict=True))
        lines.append(f"{i + 1} {j + 1}, {then} (1) : 1")
    return "\n".join(lines) + "\n"


def _fis_variable(section: str, variable: _Variable, shapes: Sequence[str]) -> list[str]:
    lines = ["", f"[{section}]", f"Name='{variable.name}'"]
    lines += [f"Range=[{variable.low!r} {variable.high!r}]", f"NumMFs={len(shapes)}"]
    terms = zip(variable.numbers, shapes, strict=True)
    return [*lines, *(f"MF{k}='{label}':{shape}" for k, (label, shape) in enumerate(terms, 1))]


def _rules(base: _RuleBase) -> list[tuple[int, int, tuple[str, ...]]]:
    """Return row, column and consequents of every rule."""
    rows, columns = len(base.cells[0]), len(base.cells[0][0])
    return [
        (i, j, tuple(cells[i][j] for cells in base.cells))
        for i in range(rows)
        for j in range(columns)
    ]


FORMATS: Mapping[str, Callable[[_RuleBase], str]] = {".fll": _fll, ".fis": _fis}
