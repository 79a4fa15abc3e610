"""IEC 61131-7's Fuzzy Control Language, ``.fcl``, translated into FLL; with fuzzylite's names for shapes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise

from .words import (
    MOST_RULES,
    Membership,
    checked_shape,
    identifier,
    number,
    numbers,
    put_once,
    term_line,
)

_SHAPES = {
    "trian": Membership("Triangle", (0, 1, 2)),
    "trape": Membership("Trapezoid", (0, 1, 2, 3)),
    "gauss": Membership("Gaussian", (0, 1)),
    "gbell": Membership("Bell", (2, 0, 1)),
    "sigm": Membership("Sigmoid", (1, 0)),
    **{
        name.lower(): Membership(name, tuple(range(count)))
        for name, count in (
            *(("Triangle", 3), ("Trapezoid", 4), ("Gaussian", 2), ("GaussianProduct", 4)),
            *(("Bell", 3), ("Sigmoid", 2), ("SigmoidDifference", 4), ("SigmoidProduct", 4)),
            *(("SShape", 2), ("ZShape", 2), ("PiShape", 4), ("Ramp", 2), ("Rectangle", 2)),
            *(("Concave", 2), ("Cosine", 2), ("Spike", 2), ("SemiEllipse", 2), ("Constant", 1)),
        )
    },
}
_AND = {
    "MIN": "Minimum",
    "PROD": "AlgebraicProduct",
    "BDIF": "BoundedDifference",
    "DPROD": "DrasticProduct",
    "EPROD": "EinsteinProduct",
    "HPROD": "HamacherProduct",
}
_OR = {
    "MAX": "Maximum",
    "ASUM": "AlgebraicSum",
    "BSUM": "BoundedSum",
    "NSUM": "NormalizedSum",
    "DSUM": "DrasticSum",
    "ESUM": "EinsteinSum",
    "HSUM": "HamacherSum",
    "SUM": "UnboundedSum",
}
RESOLUTION = 100  # points over an output's range, in the middle of as many parts
_METHODS = {
    "COG": f"Centroid {RESOLUTION}",
    "COA": f"Bisector {RESOLUTION}",
    "LM": f"SmallestOfMaximum {RESOLUTION}",
    "RM": f"LargestOfMaximum {RESOLUTION}",
    "MM": f"MeanOfMaximum {RESOLUTION}",
    "COGS": "WeightedAverage",
    "COGSS": "WeightedSum",
}
_CORNERED = ("Triangle", "Trapezoid", "SShape", "ZShape", "PiShape", "Ramp", "Rectangle")
_NAME = r"[^\W\d]\w*"
_COMMENT = re.compile(r"\(\*.*?\*\)|/\*.*?\*/|//[^\n]*", re.DOTALL)
_BLOCK = re.compile(
    r"\b(VAR_INPUT|VAR_OUTPUT|FUZZIFY|DEFUZZIFY|RULEBLOCK)\b(.*?)\bEND_(VAR|FUZZIFY|DEFUZZIFY|RULEBLOCK)\b",
    re.DOTALL | re.IGNORECASE,
)
_DECLARED = re.compile(
    rf"\s*({_NAME}(?:\s*,\s*{_NAME})*)\s*:\s*REAL\s*(?::=.*)?", re.DOTALL | re.IGNORECASE
)
_POINT = re.compile(r"\(([^(),]*),([^(),]*)\)")
_RULE = re.compile(r"RULE\s+\w+\s*:\s*IF\b(.*?)\bTHEN\b(.*)", re.DOTALL | re.IGNORECASE)
_HEADED = re.compile(r"\bRULE\s+\w+\s*:", re.IGNORECASE)
_PROPOSITION = re.compile(rf"(NOT\s+)?({_NAME})\s+IS\s+(NOT\s+)?({_NAME})$", re.IGNORECASE)
_TOKEN = re.compile(r"(\(|\)|\bAND\b|\bOR\b)", re.IGNORECASE)


def fcl_to_fll(text: str) -> str:
    """Return the rule base as FLL. Raises ValueError with the place and what is wrong."""
    text = _COMMENT.sub(" ", text)
    outside = _BLOCK.sub(" ", text).split()
    words = [word.upper() for word in outside]
    if words[:1] != ["FUNCTION_BLOCK"]:
        raise ValueError("FUNCTION_BLOCK is missing: not a .fcl file")
    if words[-1] != "END_FUNCTION_BLOCK" or len(words) > 3:
        beside = " ".join(outside[1:])[:40]
        raise ValueError(
            f"{beside!r} is in no block that has an end, or END_FUNCTION_BLOCK is missing"
        )
    declared: dict[str, list[str]] = {"VAR_INPUT": [], "VAR_OUTPUT": []}
    parts: dict[str, dict[str, str]] = {"FUZZIFY": {}, "DEFUZZIFY": {}}
    rules: list[str] = []
    accumulation = ""
    for heading, body, closing in _BLOCK.findall(text):
        opening = heading.upper()
        if not opening.startswith(closing.upper()):
            raise ValueError(f"{opening} ends with END_{closing}")
        if opening in declared:
            declared[opening] += _declared(body, opening)
        elif opening == "RULEBLOCK":
            lines, accu = _rules(body)
            rules += lines
            if accu and accumulation not in ("", accu):
                raise ValueError(f"RULEBLOCK: ACCU : {accu} and {accumulation}: give all the same")
            accumulation = accu or accumulation
        else:
            name, *rest = body.split(None, 1) or [""]
            put_once(parts[opening], name, rest[0] if rest else "", opening)
    if not rules:
        raise ValueError("RULEBLOCK is missing or has no rule, or END_RULEBLOCK is missing")
    lines = ["Engine: file"]
    for keyword, section, kind in (
        ("VAR_INPUT", "FUZZIFY", "InputVariable"),
        ("VAR_OUTPUT", "DEFUZZIFY", "OutputVariable"),
    ):
        if not declared[keyword]:
            raise ValueError(f"{keyword} is missing or has no NAME : REAL;")
        for name in declared[keyword]:
            if name not in parts[section]:
                raise ValueError(f"{section} {name} is missing")
            body = parts[section].pop(name)
            lines.append(f"{kind}: {identifier(name)}")
            lines += _variable(body, section, name, accumulation)
        if parts[section]:
            raise ValueError(
                f"{section} {next(iter(parts[section]))}: {keyword} has no such variable"
            )
    return "\n".join([*lines, *rules]) + "\n"


def _declared(body: str, opening: str) -> list[str]:
    names: list[str] = []
    for statement in filter(str.strip, body.split(";")):
        match = _DECLARED.fullmatch(statement)
        if not match:
            raise ValueError(f"{opening}: {statement.strip()[:30]!r} is not NAME : REAL")
        names += re.split(r"\s*,\s*", match[1])
    return names


def _statements(body: str) -> list[tuple[str, str]]:
    """Return ``KEY := value;`` and ``KEY : value;`` as pairs."""
    pairs = []
    for statement in body.split(";"):
        key, colon, value = statement.partition(":")
        if colon:
            pairs.append((key.strip(), value.lstrip("=").strip()))
        elif statement.strip():
            raise ValueError(f"{statement.strip()[:30]!r} is not KEY : VALUE;")
    return pairs


def _variable(body: str, section: str, name: str, accumulation: str) -> list[str]:
    """Return the lines of a variable: its range, how it is defuzzified, its terms."""
    place = f"{section} {name}"
    limits: list[float] = []
    seen: list[float] = []
    settings: dict[str, str] = {}
    terms: list[str] = []
    for key, value in _statements(body):
        word = key.split()
        if len(word) == 2 and word[0].upper() == "TERM":
            line, reach = _term(identifier(word[1]), value, f"{place}, TERM {word[1]}")
            terms.append(line)
            seen += reach
        else:
            put_once(settings, key.upper(), value, place)
    if "RANGE" in settings:
        text = settings.pop("RANGE").strip("()").replace("..", " ")
        limits = numbers(text, f"{place}, RANGE")
    elif seen:
        limits = [min(seen), max(seen)]
    if len(limits) != 2:
        raise ValueError(f"{place}: RANGE := (from .. to); is missing")
    lines = [f"  range: {limits[0]!r} {limits[1]!r}"]
    locks = {word.strip().upper() for word in settings.pop("LOCK", "").split("|")} - {""}
    if section == "DEFUZZIFY":
        for default in map(str.strip, settings.pop("DEFAULT", "NAN").upper().split("|")):
            if default == "NC":  # no change: the last output is held
                locks.add("PREVIOUS")
            elif default != "NAN":
                lines.append(f"  default: {number(default, f'{place}, DEFAULT')!r}")
        method = _choice(settings, "METHOD", _METHODS, place)
        if method.startswith("Centroid") and all(" Constant " in line for line in terms):
            method = _METHODS["COGS"]  # a centre of gravity of singletons
        own = settings.get("ACCU", accumulation).upper()
        if accumulation not in ("", own):
            raise ValueError(
                f"{place}: ACCU : {own}, but {accumulation} in the RULEBLOCK: give one"
            )
        added = _choice({"ACCU": own}, "ACCU", _OR, place, "MAX")
        settings.pop("ACCU", "")
        lines.append(f"  defuzzifier: {method}")
        lines.append(f"  aggregation: {'none' if method.startswith('Weighted') else added}")
        if "PREVIOUS" in locks:
            locks.remove("PREVIOUS")
            lines.append("  lock-previous: true")
    if "RANGE" in locks:
        locks.remove("RANGE")
        lines.append("  lock-range: true")
    lines.append(_enabled(settings, place))
    for key in (*settings, *(f"LOCK : {word}" for word in locks)):
        raise ValueError(f"{place}: {key[:30]} is not read")
    return [*lines, *terms]


def _enabled(settings: dict[str, str], place: str) -> str:
    value = settings.pop("ENABLED", "TRUE").lower()
    if value not in ("true", "false"):
        raise ValueError(f"{place}: ENABLED : {value[:30]}: give TRUE or FALSE")
    return f"  enabled: {value}"


def _term(name: str, value: str, place: str) -> tuple[str, list[float]]:
    """Return a term's line, and its corners, from which a range that is not given is taken."""
    points = _POINT.findall(value)
    if points and not _POINT.sub("", value).replace(",", "").strip():
        pairs = [(number(x, place), number(y, place)) for x, y in points]
        flat = [v for pair in pairs for v in pair]
        if any(b[0] < a[0] for a, b in pairwise(pairs)):
            raise ValueError(f"{place}: its points must be in ascending order")
        return term_line(name, "Discrete", flat), flat[::2]
    shape_name, _, rest = value.partition(" ")
    shape = _SHAPES.get(shape_name.lower())
    if shape_name.lower() == "linear":
        return term_line(name, "Linear", numbers(rest, place)), []
    if shape is None:
        constant = number(value, place)
        return term_line(name, "Constant", [constant]), [constant]
    values = numbers(rest, place)
    corners = values if shape.name in _CORNERED else []
    return term_line(name, shape.name, checked_shape(shape, shape_name, values, place)), corners


def _choice(
    settings: dict[str, str], key: str, known: Mapping[str, str], place: str, usual: str = ""
) -> str:
    word = settings.pop(key, usual).upper() or usual
    if not word:
        raise ValueError(f"{place}: {key} is missing")
    if word not in known:
        raise ValueError(f"{place}: {key} : {word[:30]}: {', '.join(known)} are read")
    return known[word]


def _rules(body: str) -> tuple[list[str], str]:
    """Return a block's lines, and how it accumulates, if it says so."""
    named = re.match(rf"\s*(?!RULE\b)({_NAME})(?!\s*:)\b", body, re.IGNORECASE)
    place = f"RULEBLOCK {named[1][:30] if named else ''}".rstrip()
    # Fuzzylite ends rules with the line, the standard with a semicolon.
    text = _HEADED.sub(lambda match: f";{match[0]}", body[named.end() :] if named else body)
    settings: dict[str, str] = {}
    rules: list[str] = []
    for statement in filter(None, map(str.strip, text.split(";"))):
        match = _RULE.fullmatch(statement)
        if match:
            rules.append(f"  rule: {_rule(match[1], match[2], f'{place}, rule {len(rules) + 1}')}")
            continue
        key, _, value = statement.partition(":")
        put_once(settings, key.strip().upper(), value.strip(), place)
    if len(rules) > MOST_RULES:
        raise ValueError(f"{place}: {len(rules)} rules: at most {MOST_RULES} are read")
    lines = [
        "RuleBlock:",
        f"  conjunction: {_choice(settings, 'AND', _AND, place, 'MIN')}",
        f"  disjunction: {_choice(settings, 'OR', _OR, place, 'MAX')}",
        f"  implication: {_choice(settings, 'ACT', _AND, place, 'MIN')}",
        f"  activation: {settings.pop('ACTIVATION', 'General')}",
        _enabled(settings, place),
        *rules,
    ]
    accumulation = settings.pop("ACCU", "").upper()
    for key in settings:
        raise ValueError(
            f"{place}: {key[:30]!r} is not a rule, nor AND, OR, ACT, ACCU, ACTIVATION, ENABLED"
        )
    return lines, accumulation


def _rule(if_: str, then: str, place: str) -> str:
    words = []
    for token in filter(None, map(str.strip, _TOKEN.split(if_))):
        words.append(
            token.lower() if _TOKEN.fullmatch(token) else _proposition(token, place, negated=True)
        )
    conclusions, *weights = re.split(r"\sWITH\s", then, flags=re.IGNORECASE)
    propositions = re.split(r",|\band\b", conclusions, flags=re.IGNORECASE)
    conclusion = " and ".join(_proposition(p.strip(), place, negated=False) for p in propositions)
    factor = number(" WITH ".join(weights) or "1", f"{place}, WITH")
    if not 0.0 <= factor <= 1.0:
        raise ValueError(f"{place}, WITH {factor:g}: give one from 0 to 1")
    return f"if {' '.join(words)} then {conclusion} with {factor!r}"


def _proposition(text: str, place: str, negated: bool) -> str:
    match = _PROPOSITION.fullmatch(re.sub(r"\s+", " ", text))
    if not match or (not negated and (match[1] or match[3])):
        allowed = "VARIABLE IS [NOT] TERM" if negated else "VARIABLE IS TERM"
        raise ValueError(f"{place}: {text[:30]!r} is not {allowed}")
    negation = "not " if bool(match[1]) != bool(match[3]) else ""
    return f"{identifier(match[2])} is {negation}{identifier(match[4])}"
