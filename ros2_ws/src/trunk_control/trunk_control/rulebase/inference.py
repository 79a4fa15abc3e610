"""A rule base as pyfuzzylite evaluates it: the reference for what is taken over.

The only module that imports pyfuzzylite, which is under the GPL and installed on request.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from math import isfinite, isnan, nan
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from trunk_core.arrays import Floats
from trunk_core.errors import NotInstalledError, RuleFileError

from .words import identifier

if TYPE_CHECKING:
    from pathlib import Path

_AT_ONCE = 2_000_000  # values of one output's membership: points x resolution
_VERTICES = ("left", "top", "right", "bottom_left", "top_left", "top_right", "bottom_right")
_FINER = 10  # times the points over an output's range, where a centroid is checked
_GRID = 45  # points along each input where it is
_EDGES = ("start", "end", "inflection", "mean", "center", "mean_a", "mean_b")


class RuleEngine:
    """A rule base with one input or two, and what pyfuzzylite makes of it.

    ``inputs`` and ``outputs``: names in the file. ``both_ends``: a centroid is computed from points that
    begin and end with the output's range, as in MATLAB, not from the middles of as many parts. Raises
    RuleFileError for a rule base that cannot be evaluated, NotInstalledError without pyfuzzylite.
    """

    def __init__(self, fll: str, path: Path, both_ends: bool = False) -> None:
        try:
            fuzzylite = import_module("fuzzylite")
        except ImportError:
            raise NotInstalledError(
                "trunk rules read needs pyfuzzylite: pip install --no-deps pyfuzzylite"
            ) from None
        self._path = path
        self._held: set[str] = set()  # outputs that keep their last value where no rule fires
        self._both_ends = both_ends
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._engine: Any = fuzzylite.FllImporter().from_string(fll)
                self._check()
        except RuleFileError:
            raise
        except Exception as error:  # whatever the library makes of the text
            raise self._wrong(str(error) or type(error).__name__) from None
        self.inputs = tuple(variable.name for variable in self._engine.input_variables)
        self.outputs = tuple(variable.name for variable in self._engine.output_variables)

    def _wrong(self, text: str) -> RuleFileError:
        short = re.sub(r"'([^']{30})[^']{10,}'", r"'\1 …'", " ".join(text.split()))
        return RuleFileError(f"{self._path}: {short[:300]}")

    def _check(self) -> None:
        engine = self._engine
        problems: list[str] = []
        if not engine.is_ready(problems):
            raise self._wrong(problems[0])
        variables = [*engine.input_variables, *engine.output_variables]
        for variable in variables:
            if not variable.enabled:
                raise self._wrong(f"{variable.name}: not enabled: switch it on, or take it out")
            names: set[str] = set()
            for term in variable.terms:
                if term.name in names:
                    raise self._wrong(f"{variable.name}: the term {term.name} is there twice")
                names.add(term.name)
                for number in _numbers_of(term):
                    if isnan(number):
                        raise self._wrong(
                            f"{variable.name}, {term.name}: a number is missing or NaN"
                        )
        for variable in engine.input_variables:
            self._check_range(variable)
        for variable in engine.output_variables:
            if hasattr(variable.defuzzifier, "resolution"):
                self._check_range(variable)
                if not 2 <= variable.defuzzifier.resolution <= 100_000:
                    raise self._wrong(f"{variable.name}: resolution: give one from 2 to 100,000")
                if self._both_ends:
                    _over_both_ends(variable.defuzzifier)
            if (
                variable.lock_previous
            ):  # a table has no memory: it must be true that it makes no difference
                self._held.add(variable.name)
                variable.lock_previous, variable.default_value = False, nan
        for number, rule in enumerate(
            (rule for block in engine.rule_blocks for rule in block.rules), 1
        ):
            if not rule.is_loaded():
                raise self._wrong(f"rule {number} cannot be read: {str(rule.text)[:60]}")
        for block in engine.rule_blocks:
            if type(block.activation).__name__ != "General":
                raise self._wrong(
                    f"activation {type(block.activation).__name__}: only General is read"
                )

    def _check_range(self, variable: Any) -> None:
        low, high = variable.range
        if not (isfinite(low) and isfinite(high) and low < high):
            raise self._wrong(
                f"{variable.name}: range {low:g} to {high:g}: give two ascending numbers"
            )

    def input(self, name: str) -> Any:
        """Return an input variable by its name in the file. Raises RuleFileError."""
        return self._variable(name, self._engine.input_variables, "input")

    def output(self, name: str) -> Any:
        """Return an output variable by its name in the file. Raises RuleFileError."""
        return self._variable(name, self._engine.output_variables, "output")

    def _variable(self, name: str, variables: Sequence[Any], kind: str) -> Any:
        for variable in variables:
            if identifier(name) == variable.name:
                return variable
        known = ", ".join(variable.name for variable in variables)
        raise RuleFileError(f"{self._path}: no {kind} {name[:40]!r}: it has {known}")

    def range(self, name: str) -> tuple[float, float]:
        """Return the ends of an input's range."""
        low, high = self.input(name).range
        return float(low), float(high)

    def vertices(self, name: str) -> list[float]:
        """Return the abscissae where an input's membership functions bend, within its range, ascending."""
        return self._bends(self.input(name))

    def _bends(self, variable: Any) -> list[float]:
        low, high = variable.range
        bends: set[float] = set()
        for term in variable.terms:
            bends.update(getattr(term, key) for key in (*_VERTICES, *_EDGES) if hasattr(term, key))
            if type(term).__name__ == "Discrete":
                bends.update(np.asarray(term.values)[:, 0].tolist())
        return sorted(float(x) for x in bends if low <= x <= high)

    def label_at(self, name: str, x: float) -> str:
        """Return the name of the only membership function of an input that is 1 at ``x``; else nothing."""
        full = [term.name for term in self.input(name).terms if float(term.membership(x)) == 1.0]
        return str(full[0]) if len(full) == 1 else ""

    def constants(self, name: str) -> dict[str, float]:
        """Return an output's singletons by their names; empty unless all of its terms are."""
        terms = self.output(name).terms
        values = {t.name: float(t.value) for t in terms if type(t).__name__ == "Constant"}
        return values if len(values) == len(terms) else {}

    def evaluate(self, points: Mapping[str, Floats], outputs: Sequence[str]) -> Floats:
        """Return the outputs (rows) at points, given by the inputs' names.

        Raises RuleFileError where no rule fires, with the point.
        """
        result = self._computed(points, outputs)
        missing = ~np.isfinite(result).all(axis=0)
        if missing.any():  # triangles that end where the range does: what they say just inside
            inside = {name: self._inside(name, values[missing]) for name, values in points.items()}
            result[:, missing] = self._computed(inside, outputs)
        missing = ~np.isfinite(result).all(axis=0)
        if missing.any():
            where = int(np.argmax(missing))
            at = ", ".join(f"{name} = {values[where]:.6g}" for name, values in points.items())
            held = sorted(self._held.intersection(outputs))
            remedy = (
                f"{held[0]} keeps its last value there (lock-previous, NC), and a table has none: "
                "cover it by a rule, or give a default instead"
                if held
                else "cover it by a rule, or give a default"
            )
            raise self._wrong(f"no rule fires at {at}: {remedy}")
        return result

    def check_centroids(
        self, ranges: Mapping[str, tuple[float, float]], outputs: Sequence[str], tolerance: float
    ) -> None:
        """Raise RuleFileError where a centroid from ten times the points differs, with the term at fault.

        ``tolerance``: a share of the output's span.
        """
        lines = (np.linspace(low, high, _GRID + 2)[1:-1] for low, high in ranges.values())
        mesh = [points.ravel() for points in np.meshgrid(*lines)]
        points = dict(zip(ranges, mesh, strict=True))
        centroids = [
            variable.defuzzifier
            for variable in self._engine.output_variables
            if type(variable.defuzzifier).__name__ == "Centroid"
        ]
        coarse = self._computed(points, outputs)
        counts = [centroid.resolution for centroid in centroids]
        for centroid in centroids:
            centroid.resolution = _FINER * (centroid.resolution - 1) + 1
        fine = self._computed(points, outputs)
        for centroid, count in zip(centroids, counts, strict=True):
            centroid.resolution = count
        for name, rough, exact in zip(outputs, coarse, fine, strict=True):
            there = np.isfinite(exact)
            span = float(np.ptp(exact[there])) if there.any() else 0.0
            off = there & ~(np.abs(rough - exact) <= tolerance * (span or 1.0))
            if off.any():
                k = int(
                    np.argmax(np.where(off, np.nan_to_num(np.abs(rough - exact), nan=np.inf), 0.0))
                )
                term, count = self._finest(name)
                at = ", ".join(f"{key} = {values[k]:.6g}" for key, values in points.items())
                raise self._wrong(
                    f"{name}: its term {term} has {count} of the points of its centroid, which is "
                    f"{rough[k]:.6g} at {at}, but {exact[k]:.6g} from ten times as many: widen the term"
                )

    def _finest(self, name: str) -> tuple[str, int]:
        """Return the term of an output that has the fewest points of its centroid, and how many."""
        variable = self.output(name)
        low, high = variable.range
        x = np.linspace(low, high, variable.defuzzifier.resolution)
        counts = {term.name: int(np.count_nonzero(term.membership(x))) for term in variable.terms}
        term = min(counts, key=counts.__getitem__)
        return term, counts[term]

    def silent_terms(self) -> list[str]:
        """Return the terms that are 0 over the whole range of their variable, as ``variable: term``."""
        silent = []
        for variable in (*self._engine.input_variables, *self._engine.output_variables):
            low, high = variable.range
            if not (isfinite(low) and isfinite(high)):
                continue
            x = np.array([*np.linspace(low, high, 1001), *self._bends(variable)])
            silent += [
                f"{variable.name}: {term.name}"
                for term in variable.terms
                if type(term).__name__ not in ("Constant", "Linear", "Function")
                and not np.any(term.membership(x))
            ]
        return silent

    def _inside(self, name: str, values: Floats) -> Floats:
        low, high = self.range(name)
        margin = 1e-9 * (high - low)
        inside: Floats = np.clip(values, low + margin, high - margin)
        return inside

    def _computed(self, points: Mapping[str, Floats], outputs: Sequence[str]) -> Floats:
        chosen = [self.output(name) for name in outputs]
        finest = max(
            getattr(v.defuzzifier, "resolution", 100) for v in self._engine.output_variables
        )
        step = max(1, _AT_ONCE // finest)
        count = len(next(iter(points.values())))
        result = np.empty((len(outputs), count))
        for start in range(0, count, step):
            part = {name: values[start : start + step] for name, values in points.items()}
            try:
                self._process(part)
                for row, variable in zip(result, chosen, strict=True):
                    row[start : start + step] = variable.value
            except Exception as error:  # whatever the library meets
                raise self._wrong(str(error) or type(error).__name__) from None
        return result

    def _process(self, points: Mapping[str, Floats]) -> None:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            for variable in self._engine.output_variables:
                variable.clear()
            terms = []
            for name, values in points.items():
                variable = self.input(name)
                variable.value = values
                for term in variable.terms:  # once, not in every rule
                    membership = term.membership(variable.value)
                    term.membership = lambda _, known=membership: known
                    terms.append(term)
            try:
                self._engine.process()
            finally:
                for term in terms:
                    del term.membership


def _over_both_ends(defuzzifier: Any) -> None:
    """Let an integral be taken at points from one end of the range to the other."""
    inner = defuzzifier.defuzzify

    def defuzzify(term: Any, low: float, high: float) -> Any:
        half = 0.5 * (high - low) / (defuzzifier.resolution - 1)
        points = np.linspace(low, high, defuzzifier.resolution)
        there = SimpleNamespace(membership=lambda x: term.membership(points.reshape(np.shape(x))))
        return inner(there, low - half, high + half)

    defuzzifier.defuzzify = defuzzify


def _numbers_of(term: Any) -> list[float]:
    numbers: list[float] = []
    for value in vars(term).values():
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            numbers.append(float(value))
        elif isinstance(value, (list, np.ndarray)):
            with_numbers = np.asarray(value)
            if with_numbers.dtype.kind == "f":
                numbers += with_numbers.ravel().tolist()
    return numbers
