"""A rule file as parameters of ``fuzzy_pid`` or ``fuzzy``, and how far these are from the file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from math import isfinite, nextafter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trunk_core.arrays import Floats
from trunk_core.errors import RuleFileError
from trunk_core.parameters.declarations import Value, build, values_of
from trunk_core.text import plain_number

from ..laws import law_named
from ..rule_tables import MOST, check_labels, input_labels
from .fcl import fcl_to_fll
from .fis import fis_to_fll
from .inference import RuleEngine
from .sampling import Checked, Deviation, Sampling, Surface, Table, check_points, sample
from .words import MOST_RULES, MOST_TERMS, put_once

OUTPUTS = {"fuzzy_pid": ("kp", "kd", "alpha"), "fuzzy": ("u",)}
INPUTS = ("e", "e_dot")
# What others call the error and its rate, without underscores.
_USUAL = {"e": ("e", "err", "error"), "e_dot": ("edot", "de", "ec", "ce", "derror", "errorrate")}
ALONE = (-1.0, 1.0)  # the range of an input that the file does not have


class Imported(NamedTuple):
    """Parameters of a law, and how far its outputs are from the file's at 100,000 points."""

    node: str
    values: dict[str, Value]
    exact: bool
    deviation: Deviation
    output: str  # that deviates most
    peaks: tuple[int, int]
    surface: Surface  # the file's
    table: Table  # as the law evaluates it, in the file's units
    outputs: tuple[str, ...]
    silent: list[str]  # ``variable: term`` of the file that is 0 over the whole range

    @property
    def text(self) -> str:
        """The greatest deviation and where it is."""
        d = self.deviation
        kind = "exact but for rounding" if self.exact else "sampled"
        return (
            f"{kind}: {self.peaks[0]} x {self.peaks[1]} peaks, greatest deviation {d.distance:.3g} of "
            f"{self.output} ({d.share:.3g} of its span) at e = {d.error:.6g}, e_dot = {d.rate:.6g}"
        )


class _Column(NamedTuple):
    """One output: of which variable in the file, or a constant."""

    key: str
    name: str
    constant: float | None


def import_rules(
    path: Path, inputs: Mapping[str, str], outputs: Mapping[str, str], tolerance: float
) -> Imported:
    """Return a rule file's table as parameters.

    ``inputs``: e and e_dot -> the file's names; ``outputs``: kp, kd, alpha or u -> the file's names, or a
    number for a constant; what is missing is searched under its own name. ``tolerance``: the greatest
    deviation, as a share of an output's span, where the table cannot be exact. Raises RuleFileError for a
    file that cannot be read or taken over, and where 64 x 64 peaks do not keep the tolerance.
    """
    engine = RuleEngine(read_fll(path), path, both_ends=path.suffix.lower() == ".fis")
    names = _inputs(engine, inputs, path)
    columns = _outputs(engine, outputs, path)
    node = "fuzzy" if columns[0].key == "u" else "fuzzy_pid"
    variable = [column for column in columns if column.constant is None]
    if not variable:
        raise RuleFileError(
            f"{path}: --output-variable gives only constants: name an output of the file"
        )

    def surface(error: Floats, rate: Floats) -> Floats:
        points = {
            names[key]: x for key, x in zip(INPUTS, (error, rate), strict=True) if key in names
        }
        rows = iter(engine.evaluate(points, [column.name for column in variable]))
        return np.array(
            [next(rows) if c.constant is None else np.full(len(error), c.constant) for c in columns]
        )

    ranges = [engine.range(names[key]) if key in names else ALONE for key in INPUTS]
    bends = [engine.vertices(names[key]) if key in names else [] for key in INPUTS]
    engine.check_centroids(
        {names[key]: limits for key, limits in zip(INPUTS, ranges, strict=True) if key in names},
        [column.name for column in variable],
        tolerance,
    )
    checked = check_points(surface, ranges)
    sampling = sample(surface, checked, ranges, bends, tolerance)
    values = _values(engine, names, ranges, columns, sampling, path)
    declared = law_named(node).config
    config = build(declared, {**values_of(declared()), **values})
    result = _judged(path, config, node, values, columns, sampling, checked, surface, tolerance)
    return result._replace(silent=engine.silent_terms())


def _judged(
    path: Path,
    config: Any,
    node: str,
    values: dict[str, Value],
    columns: Sequence[_Column],
    sampling: Sampling,
    checked: Checked,
    surface: Surface,
    tolerance: float,
) -> Imported:
    """Return the import, measured again with the numbers that the law will compute with."""
    table = as_evaluated(config, "gains.p_min" in values, "gains.d_min" in values)
    deviation = checked.deviation(table)
    result = Imported(
        node, values, sampling.exact and deviation.share <= 1e-11, deviation,
        columns[deviation.output].key, (len(table.error_peaks), len(table.rate_peaks)),
        surface, table, tuple(column.key for column in columns), [],
    )  # fmt: skip
    if not result.exact and deviation.share > tolerance:
        raise RuleFileError(
            f"{path}: {result.text}: {MOST} x {MOST} peaks come no closer than that to it (a jump?): "
            f"--tolerance {1.05 * deviation.share:.2g} takes it so"
        )
    return result


def as_evaluated(config: Any, p_scaled: bool = False, d_scaled: bool = False) -> Table:
    """Return a law's tables at its peaks in rad and rad/s, ``u`` in N m.

    ``p_scaled``, ``d_scaled``: Kp, Kd as gains, not as Kp', Kd' from 0 to 1.
    """
    error, rate = (np.array(peaks) for peaks in config.peaks)
    layers = []
    for table in config.tables:
        layer = np.array(table.values(config.axes)).reshape(len(error), len(rate))
        if table.name == "kp" and p_scaled:
            layer = config.p_min + (config.p_max - config.p_min) * layer
        elif table.name == "kd" and d_scaled:
            layer = config.d_min + (config.d_max - config.d_min) * layer
        elif table.name == "u":
            layer = config.output_scale * layer
        layers.append(layer)
    return Table(error, rate, np.array(layers))


def _inputs(engine: RuleEngine, given: Mapping[str, str], path: Path) -> dict[str, str]:
    if len(engine.inputs) > 2:
        raise RuleFileError(
            f"{path}: it has {len(engine.inputs)} inputs ({', '.join(engine.inputs)[:80]}): a table has two, "
            "e and e_dot"
        )
    taken = {key: engine.input(name).name for key, name in given.items()}
    for key in INPUTS:
        usual = [name for name in engine.inputs if name.replace("_", "").lower() in _USUAL[key]]
        if key not in taken and len(usual) == 1 and usual[0] not in taken.values():
            taken[key] = usual[0]
    if len(engine.inputs) == 2 and len(taken) == 1:  # where one is known, the other follows
        (other,) = set(INPUTS) - taken.keys()
        taken[other] = next(name for name in engine.inputs if name not in taken.values())
    for name in engine.inputs:
        if list(taken.values()).count(name) != 1:
            raise RuleFileError(
                f"{path}: its inputs are {', '.join(engine.inputs)}: say which is e and which "
                f"e_dot, each once: --input e=NAME --input e_dot=NAME"
            )
    return taken


def _outputs(engine: RuleEngine, given: Mapping[str, str], path: Path) -> list[_Column]:
    known = [key for keys in OUTPUTS.values() for key in keys]
    names = dict(given) or {key: key for key in known if key in engine.outputs}
    for keys in OUTPUTS.values():
        if set(names) == set(keys):
            return [_column(engine, key, names[key]) for key in keys]
    raise RuleFileError(
        f"{path}: its outputs are {', '.join(engine.outputs)[:80]}: say what they are: "
        "--output-variable u=NAME, or kp=, kd= and alpha= together, each a NAME or a number"
    )


def _column(engine: RuleEngine, key: str, name: str) -> _Column:
    try:
        constant = plain_number(name)
    except ValueError:
        return _Column(key, engine.output(name).name, None)
    if not isfinite(constant):
        raise RuleFileError(
            f"--output-variable {key}={name}: give a finite number or an output's name"
        )
    return _Column(key, name, constant)


def _values(
    engine: RuleEngine,
    names: Mapping[str, str],
    ranges: Sequence[tuple[float, float]],
    columns: Sequence[_Column],
    sampling: Sampling,
    path: Path,
) -> dict[str, Value]:
    """Return the parameters of a table."""
    table = sampling.table
    share = fraction if sampling.exact else _rounded
    values: dict[str, Value] = {}
    labels: dict[str, Value] = {}
    for axis, key, limits, peaks in zip(
        ("error", "rate"), INPUTS, ranges, (table.error_peaks.tolist(), table.rate_peaks.tolist()),
        strict=True,
    ):  # fmt: skip
        if key not in names:  # whatever its universe
            values[f"fuzzy.{axis}_peaks"] = ALONE
            continue
        reach = max(map(abs, limits))
        values[f"fuzzy.{axis}_range"] = reach
        values[f"fuzzy.{axis}_peaks"] = tuple(share(peak, reach) for peak in peaks)
        named = tuple(engine.label_at(names[key], peak) for peak in peaks)
        if _usable(named) and named != input_labels((), len(named), axis[0].upper()):
            labels[f"fuzzy.{axis}_labels"] = named
    values |= labels
    for column, layer in zip(columns, table.values, strict=True):
        values |= _table_values(engine, column, layer, share, path)
    return values


def _table_values(
    engine: RuleEngine,
    column: _Column,
    layer: Floats,
    share: Callable[[float, float], float],
    path: Path,
) -> dict[str, Value]:
    """Return the parameters of one output: its scale, labels where the file has singletons, the rows."""
    low, high = _limits(engine, column, layer)
    names = {} if column.constant is not None else engine.constants(column.name)
    values: dict[str, Value] = {}
    key = "output" if column.key == "u" else column.key
    offset, scale = 0.0, 1.0
    if column.key == "u":
        scale = max(map(abs, (low, high, *names.values()))) or 1.0
        values["fuzzy.output_scale"] = scale
    elif column.key == "alpha":
        if float(layer.min()) <= 0.0:
            raise RuleFileError(
                f"{path}: alpha has the value {layer.min():.6g}: it must be above 0"
            )
    elif low < 0.0 or high > 1.0:
        offset, scale = float(layer.min()), float(np.ptp(layer))
        if offset <= 0.0:
            raise RuleFileError(
                f"{path}: {column.key} has values from {layer.min():.6g} to {layer.max():.6g}: give an "
                "output from 0 to 1, or a gain above 0"
            )
        values[f"gains.{column.key[1]}_min"] = offset
        values[f"gains.{column.key[1]}_max"] = offset + scale
        scale = scale or 1.0
    centers = {
        name: fraction(center - offset, scale)
        for name, center in names.items()
        if not name.startswith("_")  # a number, as exported, or as fuzzylite names it
    }
    if len(centers) <= MOST and _usable(tuple(centers)):
        values[f"fuzzy.{key}_labels"] = tuple(centers)
        values[f"fuzzy.{key}_centers"] = tuple(centers.values())
    else:
        centers = {}
    by_center = {center: name for name, center in reversed(centers.items())}

    def cell(number: float) -> str:
        center = share(number - offset, scale)
        return by_center.get(center, repr(center))

    values[f"rules.{column.key}"] = tuple(" ".join(map(cell, row)) for row in layer.tolist())
    return values


def _limits(engine: RuleEngine, column: _Column, layer: Floats) -> tuple[float, float]:
    """Return the range that an output has in the file, or else its values'."""
    values = float(layer.min()), float(layer.max())
    if column.constant is not None:
        return values
    low, high = map(float, engine.output(column.name).range)
    declared = isfinite(low) and isfinite(high) and low <= values[0] and values[1] <= high
    return (low, high) if declared else values


def _usable(labels: Sequence[str]) -> bool:
    try:
        check_labels(labels)
    except ValueError:
        return False
    return all(labels) and bool(labels)


def _rounded(number: float, whole: float) -> float:
    """Return a rounded share: sampled values do not justify more digits."""
    return round(number / whole, 9) + 0.0  # not -0.0


def fraction(number: float, whole: float) -> float:
    """Return the share that times ``whole`` is ``number``, bit for bit if any is, the shortest of these."""
    share = number / whole
    near = {share}
    up = down = share
    for _ in range(2):
        up, down = nextafter(up, 9e99), nextafter(down, -9e99)
        near |= {up, down}
    exact = [s for s in near if s * whole == number]
    return min(exact, key=lambda s: (len(repr(s)), abs(s - share))) if exact else share


LARGEST = 4_000_000  # bytes
_COMPONENTS = "Engine InputVariable OutputVariable RuleBlock".split()  # noqa: SIM905
_REPEATED = ("rule", "term")
_KEYS = (
    *(*_COMPONENTS, *_REPEATED, "description", "enabled", "range", "lock-range", "lock-previous"),
    *("aggregation", "defuzzifier", "default", "conjunction", "disjunction", "implication", "activation"),
)  # fmt: skip
_LOST = re.compile(rf"\s+(?=(?:{'|'.join(_KEYS)})\s*:)")


def checked_fll(text: str) -> str:
    """Return FLL with lost ends of lines. Raises ValueError for a line that pyfuzzylite would drop."""
    if "\n" not in text.strip():
        text = _LOST.sub("\n", text)
    seen: dict[str, str] = {}
    for line in text.splitlines():
        key, _, value = (word.strip() for word in line.partition("#")[0].partition(":"))
        if key in _COMPONENTS:
            seen.clear()
        elif key and not seen:
            raise ValueError(f"{key[:30]!r} stands before the first component: not a .fll file")
        if key and key not in _KEYS:
            raise ValueError(f"{key[:30]!r} is not a key of a .fll file")
        if key and key not in _REPEATED:
            put_once(seen, key, value, next(iter(seen), key))
    return text


TRANSLATIONS: Mapping[str, Callable[[str], str]] = {
    ".fis": fis_to_fll,
    ".fll": checked_fll,
    ".fcl": fcl_to_fll,
}


def read_fll(path: Path) -> str:
    """Return a rule file as FLL. Raises RuleFileError for one that cannot be used."""
    translate = TRANSLATIONS.get(path.suffix.lower())
    if translate is None:
        raise RuleFileError(f"{path}: the file's name must end in {', '.join(TRANSLATIONS)}")
    text = _text(path)
    try:
        fll = translate(text)
    except ValueError as error:
        raise RuleFileError(f"{path}: {error}") from None
    for word, most in (("rule", MOST_RULES), ("term", MOST_TERMS)):
        count = len(re.findall(rf"^\s*{word}\s*:", fll, re.MULTILINE))
        if count > most:
            raise RuleFileError(f"{path}: {count} {word}s: at most {most} are read")
    return fll


def _text(path: Path) -> str:
    if path.exists() and not path.is_file():  # reading a pipe would block
        raise RuleFileError(f"{path}: not a regular file: give a file of rules")
    with path.open("rb") as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise RuleFileError(f"{path}: more than {LARGEST / 1e6:g} MB: no rule file is that large")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if re.search(r"[\x00-\x08\x0e-\x1f\x7f-\x84\x86-\x9f]", text):
        raise RuleFileError(f"{path}: not a text in UTF-8 or Latin-1: save it as UTF-8")
    return re.sub("\r\n?", "\n", text)
