"""Numbers of many runs at once, one for each: what computes with a float computes with a column of them.

So the parameters of many runs pass through the very functions and checks of one run. Each operation is that
of a double, run by run, with its bits; where a comparison splits the runs, each part goes its own way.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator
from itertools import repeat
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trunk_core.errors import TrunkError

Result = TypeVar("Result")
Rows = NDArray[np.int64]  # indices of runs
Operation = Callable[[Any, object], "Varied"]
_EXACT = 2.0**53  # below it every whole double is one integer


class SplitError(TrunkError):
    """Runs differ in a condition: ``chosen`` [runs] says which of them fulfil it."""

    def __init__(self, chosen: NDArray[np.bool_]) -> None:
        self.chosen = chosen


def _of(value: object) -> Any:
    """Return an operand as NumPy takes it: exactly a double."""
    if isinstance(value, Varied):
        return value.values
    if isinstance(value, int) and abs(value) < _EXACT:
        return float(value)
    if isinstance(value, float):
        return value
    raise TypeError(f"{value!r}: not a double")


def _quotient(a: Any, b: Any) -> Any:
    if not np.all(b):
        raise TypeError("a division by zero")  # raises for one run
    return a / b


def _agreed(fulfilled: NDArray[np.bool_]) -> bool:
    first = bool(fulfilled[0])
    if (fulfilled != first).any():
        raise SplitError(fulfilled)
    return first


def _operations(compute: Callable[[Any, Any], Any]) -> tuple[Operation, Operation]:
    """Return the methods for a number of runs on the left and on the right of an operator."""
    return (
        lambda self, other: Varied(compute(self.doubles(), _of(other))),
        lambda self, other: Varied(compute(_of(other), self.doubles())),
    )


def _comparison(compare: Callable[[Any, Any], NDArray[np.bool_]]) -> Callable[[Any, object], bool]:
    return lambda self, other: _agreed(compare(self.values, _of(other)))


class Varied:
    """A number of each run [runs], doubles or, rounded, integers that only serve as values.

    What gives no column of doubles with the scalar operation's bits raises TypeError.
    """

    __slots__ = ("values",)
    __hash__ = None  # type: ignore[assignment]
    __add__, __radd__ = _operations(operator.add)
    __sub__, __rsub__ = _operations(operator.sub)
    __mul__, __rmul__ = _operations(operator.mul)
    __truediv__, __rtruediv__ = _operations(_quotient)
    __lt__, __le__ = _comparison(operator.lt), _comparison(operator.le)
    __gt__, __ge__ = _comparison(operator.gt), _comparison(operator.ge)
    __eq__, __ne__ = _comparison(operator.eq), _comparison(operator.ne)

    def __init__(self, values: NDArray[Any]) -> None:
        self.values = values

    def __repr__(self) -> str:
        return f"Varied({self.values!r})"

    def __len__(self) -> int:
        raise TypeError("a column stands for a number")

    def __neg__(self) -> Varied:
        return Varied(-self.doubles())

    def __abs__(self) -> Varied:
        return Varied(np.abs(self.doubles()))

    def __round__(self) -> Varied:
        values = np.rint(self.doubles())
        if not (np.abs(values) < _EXACT).all():
            raise TypeError("too large for exact integers")
        return Varied(values.astype(np.int64))

    def __bool__(self) -> bool:
        return _agreed(self.values != 0)

    @property
    def ends(self) -> tuple[Any, Any]:
        """The least and the greatest."""
        return self.values.min().item(), self.values.max().item()

    def doubles(self) -> NDArray[np.float64]:
        """Return the values. Raises TypeError for integers."""
        if self.values.dtype != np.float64:
            raise TypeError("integers of a column only serve as values")
        return self.values


def each_run(record: Any, count: int) -> Iterable[Any]:
    """Return a number, or the numbers of tuples, as each of ``count`` runs has them."""
    if isinstance(record, Varied):
        numbers: list[Any] = record.values.tolist()
        return numbers
    if not isinstance(record, tuple) or not varies(record):
        return repeat(record, count)
    runs = zip(*(each_run(part, count) for part in record), strict=True)
    make: Callable[[Iterable[Any]], Any] = getattr(record, "_make", tuple)
    return map(make, runs)


def varies(record: tuple[Any, ...]) -> bool:
    """Return True if there are columns in a tuple, or in tuples in it."""
    return any(
        isinstance(part, Varied) or (isinstance(part, tuple) and varies(part)) for part in record
    )


def by_path(evaluate: Callable[[Rows], Result], rows: Rows) -> Iterator[tuple[Rows, Result]]:
    """Yield the rows that go each way through ``evaluate``, and its result for them."""
    waiting = [rows]
    while waiting:
        part = waiting.pop()
        try:
            with np.errstate(all="ignore"):
                result = evaluate(part)
        except SplitError as split:
            waiting += [part[~split.chosen], part[split.chosen]]
        else:
            yield part, result
