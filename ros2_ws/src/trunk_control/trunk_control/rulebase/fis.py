"""MATLAB's and Octave's ``.fis``, translated into FLL; with what fuzzylite writes into it.

Sugeno's weighted average and sum add up the rules, whatever ImpMethod and AggMethod are, as in MATLAB.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from .words import (
    MOST_RULES,
    Membership,
    checked_shape,
    identifiers,
    number,
    numbers,
    put_once,
    term_line,
)

_SHAPES = {
    "trimf": Membership("Triangle", (0, 1, 2)),
    "trapmf": Membership("Trapezoid", (0, 1, 2, 3)),
    "gaussmf": Membership("Gaussian", (1, 0)),
    "gauss2mf": Membership("GaussianProduct", (1, 0, 3, 2)),
    "gbellmf": Membership("Bell", (2, 0, 1)),
    "sigmf": Membership("Sigmoid", (1, 0)),
    "dsigmf": Membership("SigmoidDifference", (1, 0, 2, 3)),
    "psigmf": Membership("SigmoidProduct", (1, 0, 2, 3)),
    "smf": Membership("SShape", (0, 1)),
    "zmf": Membership("ZShape", (0, 1)),
    "pimf": Membership("PiShape", (0, 1, 2, 3)),
    "linsmf": Membership("Ramp", (0, 1)),
    "linzmf": Membership("Ramp", (1, 0)),
    "constant": Membership("Constant", (0,)),
    # These are fuzzylite's own.
    "rampmf": Membership("Ramp", (0, 1)),
    "rectmf": Membership("Rectangle", (0, 1)),
    "concavemf": Membership("Concave", (0, 1)),
    "cosinemf": Membership("Cosine", (0, 1)),
    "spikemf": Membership("Spike", (0, 1)),
    "sellipsemf": Membership("SemiEllipse", (0, 1)),
}
_ALL_NUMBERS = {"linear": "Linear", "discretemf": "Discrete"}
_AND = {
    "": "none",
    "min": "Minimum",
    "prod": "AlgebraicProduct",
    "algebraic_product": "AlgebraicProduct",
    "bounded_difference": "BoundedDifference",
    "drastic_product": "DrasticProduct",
    "einstein_product": "EinsteinProduct",
    "hamacher_product": "HamacherProduct",
}
_OR = {
    "": "none",
    "max": "Maximum",
    "probor": "AlgebraicSum",
    "algebraic_sum": "AlgebraicSum",
    "bounded_sum": "BoundedSum",
    "drastic_sum": "DrasticSum",
    "einstein_sum": "EinsteinSum",
    "hamacher_sum": "HamacherSum",
    "sum": "UnboundedSum",
}
RESOLUTION = 101  # points over an output's range, with both ends
_DEFUZZIFIERS = {
    "centroid": f"Centroid {RESOLUTION}",
    "bisector": f"Bisector {RESOLUTION}",
    "mom": f"MeanOfMaximum {RESOLUTION}",
    "som": f"SmallestOfMaximum {RESOLUTION}",
    "lom": f"LargestOfMaximum {RESOLUTION}",
    "wtaver": "WeightedAverage",
    "wtsum": "WeightedSum",
}
_TYPES = ("mamdani", "sugeno")
_SYSTEM = frozenset(
    "Name Type Version NumInputs NumOutputs NumRules "  # noqa: SIM905
    "AndMethod OrMethod ImpMethod AggMethod DefuzzMethod".split()
)
_SWITCHES = {"Enabled": "enabled", "LockRange": "lock-range", "LockPrevious": "lock-previous"}
# Octave's hedges are a fraction of an index; those that fuzzylite has too.
_HEDGES = {0: "", 5: "somewhat ", 20: "very ", 40: "very very "}
_RULE = re.compile(r"([^,]+),([^(]+)\(([^)]*)\)\s*:\s*(\S+)")
_SECTION = re.compile(r"\[(\w+)\]$")
_TERM = re.compile(r"'([^']*)'\s*:\s*'([^']*)'\s*,\s*\[([^\]]*)\]$")


def fis_to_fll(text: str) -> str:
    """Return the rule base as FLL. Raises ValueError with the place and what is wrong."""
    sections = _sections(text)
    system = _part(sections, "System")
    kind = _word(system, "Type", "[System]").lower()
    if kind not in _TYPES:
        raise ValueError(f"[System] Type={kind!r}: give one of {', '.join(_TYPES)}")
    sugeno = kind == "sugeno"
    inputs = [f"Input{i}" for i in range(1, _count(system, "NumInputs", "[System]") + 1)]
    outputs = [f"Output{i}" for i in range(1, _count(system, "NumOutputs", "[System]") + 1)]
    parts = {name: _part(sections, name) for name in (*inputs, *outputs)}
    for place in sections.keys() - parts.keys() - {"System", "Rules"}:
        raise ValueError(f"[{place[:30]}] is not read")
    for key in system.keys() - _SYSTEM:
        raise ValueError(f"[System] {key[:30]} is not read")
    names = identifiers(_word(part, "Name", f"[{name}]") for name, part in parts.items())
    named = dict(zip(parts, names, strict=True))
    terms = {
        name: identifiers(term for term, _, _ in _terms(part, name)) for name, part in parts.items()
    }
    lines = ["Engine: file"]
    for name in inputs:
        lines += [f"InputVariable: {named[name]}", *_variable(parts[name], name, terms[name])]
    defuzzifier = _choice(system, "DefuzzMethod", _DEFUZZIFIERS)
    if sugeno and not defuzzifier.startswith("Weighted"):
        raise ValueError(
            f"[System] Type='sugeno' with DefuzzMethod={system['DefuzzMethod']}: give wtaver or wtsum"
        )
    aggregation = "none" if sugeno else _choice(system, "AggMethod", _OR)
    for name in outputs:
        lines += [
            f"OutputVariable: {named[name]}",
            f"  aggregation: {aggregation}",
            f"  defuzzifier: {defuzzifier}",
            *_variable(parts[name], name, terms[name]),
        ]
    lines += [
        "RuleBlock:",
        f"  conjunction: {_choice(system, 'AndMethod', _AND)}",
        f"  disjunction: {_choice(system, 'OrMethod', _OR)}",
        f"  implication: {'none' if sugeno else _choice(system, 'ImpMethod', _AND)}",
        "  activation: General",
    ]
    rules = sections.get("Rules", [])
    if len(rules) != _count(system, "NumRules", "[System]"):
        raise ValueError(f"NumRules={system['NumRules']}, but there are {len(rules)} rules")
    if len(rules) > MOST_RULES:
        raise ValueError(f"{len(rules)} rules: at most {MOST_RULES} are read")
    sides = [[(named[name], terms[name]) for name in group] for group in (inputs, outputs)]
    for i, line in enumerate(rules, 1):
        lines.append(f"  rule: {_rule(line, sides[0], sides[1], f'rule {i}')}")
    return "\n".join(lines) + "\n"


def _sections(text: str) -> dict[str, list[str]]:
    """Return each section's lines, without comments."""
    sections: dict[str, list[str]] = {}
    lines: list[str] | None = None
    for raw in text.splitlines():
        line = raw.strip()
        if not line or line[0] in "%#":
            continue
        heading = _SECTION.match(line)
        if heading:
            if heading[1] in sections:
                raise ValueError(f"[{heading[1]}] is there twice")
            lines = sections[heading[1]] = []
        elif lines is None:
            raise ValueError(f"{line[:30]!r} stands before the first section: not a .fis file")
        else:
            lines.append(line)
    return sections


def _part(sections: Mapping[str, list[str]], name: str) -> dict[str, str]:
    if name not in sections:
        raise ValueError(f"[{name}] is missing")
    values: dict[str, str] = {}
    for line in sections[name]:
        key, equals, value = line.partition("=")
        if not equals:
            raise ValueError(f"[{name}]: {line[:30]!r} is not KEY=VALUE")
        put_once(values, key.strip(), value.strip(), f"[{name}]")
    return values


def _value(part: Mapping[str, str], key: str, place: str) -> str:
    if key not in part:
        raise ValueError(f"{place}: {key}= is missing")
    return part[key]


def _word(part: Mapping[str, str], key: str, place: str) -> str:
    return _value(part, key, place).strip("'\"")


def _count(part: Mapping[str, str], key: str, place: str) -> int:
    value = number(_value(part, key, place), f"{place} {key}")
    if not 0 <= value <= 1e6 or value != int(value):
        raise ValueError(f"{place} {key}={value:g}: give a whole number")
    return int(value)


def _choice(system: Mapping[str, str], key: str, known: Mapping[str, str]) -> str:
    word = _word(system, key, "[System]")
    if word not in known:
        raise ValueError(f"[System] {key}={word[:30]!r}: {', '.join(filter(None, known))} are read")
    return known[word]


def _terms(part: Mapping[str, str], place: str) -> list[tuple[str, str, list[float]]]:
    """Return a variable's membership functions: name, shape in FLL, its parameters."""
    count = _count(part, "NumMFs", f"[{place}]")
    has = sum(bool(re.fullmatch(r"MF\d+", key)) for key in part)
    if has != count:
        raise ValueError(f"[{place}]: NumMFs={count}, but there are {has} membership functions")
    terms = []
    for i in range(1, count + 1):
        where = f"[{place}] MF{i}"
        match = _TERM.match(_value(part, f"MF{i}", f"[{place}]"))
        if not match:
            raise ValueError(f"{where}: give 'name':'type',[numbers]")
        values = numbers(match[3], where)
        shape = _SHAPES.get(match[2])
        if match[2] in _ALL_NUMBERS and values:
            terms.append((match[1], _ALL_NUMBERS[match[2]], values))
            continue
        if shape is None:
            known = ", ".join((*_SHAPES, *_ALL_NUMBERS))
            raise ValueError(f"{where}: type {match[2][:30]!r}: {known} are read")
        padding = values[len(shape.order) :]  # MATLAB's first releases filled up with zeros
        # Between commas and spaces a comma may be a decimal one.
        if not any(padding) and not ("," in match[3] and re.search(r"[^,\s]\s+[^,\s]", match[3])):
            values = values[: len(shape.order)]
        terms.append((match[1], shape.name, checked_shape(shape, match[2], values, where)))
    return terms


def _variable(part: Mapping[str, str], place: str, names: list[str]) -> list[str]:
    limits = numbers(_value(part, "Range", f"[{place}]").strip("[]"), f"[{place}] Range")
    lines = [f"  range: {' '.join(map(repr, limits))}"]
    for key, value in part.items():
        where = f"[{place}] {key[:30]}"
        if key in _SWITCHES and (place.startswith("Output") or key != "LockPrevious"):
            lines.append(f"  {_SWITCHES[key]}: {'true' if _switch(value, where) else 'false'}")
        elif key == "Default" and place.startswith("Output"):
            if value.lower() != "nan":
                lines.append(f"  default: {number(value, where)!r}")
        elif key not in ("Name", "Range", "NumMFs") and not re.fullmatch(r"MF\d+", key):
            raise ValueError(f"{where} is not read")
    for name, (_, shape, values) in zip(names, _terms(part, place), strict=True):
        lines.append(term_line(name, shape, values))
    return lines


def _switch(value: str, place: str) -> bool:
    if value not in ("0", "1"):
        raise ValueError(f"{place}={value[:30]}: give 0 or 1")
    return value == "1"


def _rule(
    line: str,
    inputs: list[tuple[str, list[str]]],
    outputs: list[tuple[str, list[str]]],
    place: str,
) -> str:
    """Return a rule of indices, ``1 -2, 3 (1) : 1``, in words."""
    match = _RULE.fullmatch(line)
    if not match:
        raise ValueError(f"{place}: {line[:30]!r} is not 'inputs, outputs (weight) : 1 or 2'")
    connective = {1.0: " and ", 2.0: " or "}.get(number(match[4], place))
    if connective is None:
        raise ValueError(f"{place}: {match[4][:30]!r} at its end: give 1 for and, 2 for or")
    if_ = _propositions(numbers(match[1], place), inputs, f"{place}, inputs")
    then = _propositions(numbers(match[2], place), outputs, f"{place}, outputs")
    if not if_ or not then:
        raise ValueError(f"{place}: it has no {'outputs' if if_ else 'inputs'}")
    if any(" is not " in proposition for proposition in then):
        raise ValueError(f"{place}: a negated output is not read")
    weight = number(match[3], f"{place}, weight")
    if not 0.0 <= weight <= 1.0:
        raise ValueError(f"{place}, weight {weight:g}: give one from 0 to 1")
    return f"if {connective.join(if_)} then {' and '.join(then)} with {weight!r}"


def _propositions(
    indices: list[float], variables: list[tuple[str, list[str]]], place: str
) -> list[str]:
    if len(indices) != len(variables):
        raise ValueError(f"{place}: {len(indices)} indices for {len(variables)} variables")
    propositions = []
    for index, (name, terms) in zip(indices, variables, strict=True):
        if index == 0.0:
            continue
        hundredths = round(abs(index) % 1.0 * 100.0) if abs(index) <= len(terms) + 1 else 0
        which = abs(index) if hundredths == 0 else int(abs(index))
        if not 1 <= which <= len(terms) or which != int(which):
            raise ValueError(
                f"{place}: {name} has {len(terms)} membership functions, not {index:g}"
            )
        if hundredths not in _HEDGES:
            raise ValueError(f"{place}: {index:g}: of Octave's hedges .05, .20 and .40 are read")
        negation = "not " if index < 0.0 else ""
        propositions.append(f"{name} is {negation}{_HEDGES[hundredths]}{terms[int(which) - 1]}")
    return propositions
