"""A hip's measured path as a Fourier series, for ``path.cosines`` and ``path.sines``: least squares."""

from __future__ import annotations

import re
from math import isfinite, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trunk_control.computed_torque import ComputedTorqueConfig
from trunk_msgs_util.mechanics import path_height
from trunk_msgs_util.parameters.declarations import ParameterError, UnitError, Value, build
from trunk_msgs_util.parameters.to_si import read_quantity
from trunk_msgs_util.recording.joint_table import Floats
from trunk_sim.config import SimulatorConfig

from ..errors import PlanError

MOST_POINTS = 1_000_000
_LONGEST = 1000  # characters of a line
_UNIT = re.compile(r"[\[(]([^])]*)[])]\s*$")  # in brackets, at a heading's end
_STARTS_A_NUMBER = re.compile(r"\s*[-+.\d]")
_LEAST = (
    1e-6  # of the largest singular value: what the points determine worse counts as undetermined
)


class PathFit(NamedTuple):
    """The series of a path, and how far the points are from it, their mean height left out (m)."""

    wavenumber: float  # rad/m
    cosines: tuple[float, ...]  # m
    sines: tuple[float, ...]  # m
    rms: float
    largest: float

    @property
    def parameters(self) -> dict[str, dict[str, Value]]:
        """The parameters of the simulator, and of the model of ``computed_torque``."""
        names = ("amplitude", "wavenumber", "cosines", "sines")
        values: tuple[Value, ...] = (0.0, self.wavenumber, self.cosines, self.sines)
        return {
            "simulator": {f"path.{n}": v for n, v in zip(names, values, strict=True)},
            "computed_torque": {f"model.path_{n}": v for n, v in zip(names, values, strict=True)},
        }


def read_points(path: Path) -> tuple[Floats, Floats]:
    """Return x and y [m] of a CSV file: an ``x,y`` pair per line; a header may give units, ``x [mm],y [mm]``.

    Without a unit in brackets they are in m. Raises PlanError, which names the line, and OSError.
    """
    points: list[tuple[float, float]] = []
    scales = 1.0, 1.0
    if not path.is_file():
        raise PlanError(f"{path}: no such file: give a CSV file of x and y")
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(iter(lambda: file.readline(_LONGEST), ""), 1):
                point = _point(line)
                if point is not None:
                    points.append(point)
                elif number == 1 and not _STARTS_A_NUMBER.match(line):
                    scales = _units(line, path)
                elif line.strip():
                    raise PlanError(
                        f"{path}, line {number}: {line.strip()[:60]!r}: give x and y in m, two finite "
                        "numbers with a comma between"
                    )
                if len(points) > MOST_POINTS:
                    raise PlanError(f"{path}: more than {MOST_POINTS} points: give fewer")
    except UnicodeDecodeError:
        raise PlanError(f"{path}: not UTF-8 text: give a CSV file of x and y") from None
    x, y = np.array(points).reshape(-1, 2).T * np.array([scales]).T
    return x, y


def _units(header: str, path: Path) -> tuple[float, float]:
    """Return a metre's share of the units that a header gives. Raises PlanError."""
    scales = []
    for cell in header.split(","):
        unit = _UNIT.search(cell)
        try:
            scales.append(read_quantity(f"1 {unit[1].strip()}", "m") if unit else 1.0)
        except UnitError as error:
            raise PlanError(f"{path}, line 1: {cell.strip()[:60]!r}: {error}") from None
    if len(scales) != 2:
        raise PlanError(
            f"{path}, line 1: {header.strip()[:60]!r}: give x and y, two columns with a comma between"
        )
    return scales[0], scales[1]


def _point(line: str) -> tuple[float, float] | None:
    try:
        x, y = (float(number) for number in line.split(","))
    except ValueError:
        return None
    return (x, y) if isfinite(x) and isfinite(y) else None


def fit_path(x: Floats, y: Floats, harmonics: int, period: float | None = None) -> PathFit:
    """Return the series of so many harmonics that is nearest to the points, by least squares.

    ::

        y = c + sum over n = 1 ... N of  a_n cos(n k x) + b_n sin(n k x),    k = 2 pi / period

    ``period`` [m]; by default from the first x to the last, which then is the first point again. The mean
    height c is left out: it moves nothing. Raises PlanError for points that do not determine it,
    ParameterError for coefficients that the parameters do not take.
    """
    if len(x) < 2 * harmonics + 1:
        raise PlanError(
            f"{len(x)} points: {harmonics} harmonics have {2 * harmonics + 1} coefficients: "
            "give more points, or fewer --harmonics"
        )
    length = abs(float(x[-1] - x[0])) if period is None else period
    if not 0.0 < length < float("inf"):
        raise PlanError("the first x equals the last: give the path's --period in m")
    k = 2.0 * pi / length
    try:
        build(SimulatorConfig, {"path.wavenumber": k})
    except ParameterError as error:
        raise PlanError(
            f"a period of {length:g} m makes path.wavenumber {k:g} rad/m ({error.allowed}): "
            "x is the first column, in m unless its header names another unit"
        ) from None
    waves = np.outer(x * k, np.arange(1, harmonics + 1))
    columns = np.hstack([np.ones((len(x), 1)), np.cos(waves), np.sin(waves)])
    coefficients, _, rank, _ = np.linalg.lstsq(columns, y, rcond=_LEAST)
    if rank < columns.shape[1]:
        raise PlanError(
            f"the points determine {rank} of the {columns.shape[1]} coefficients of {harmonics} harmonics: "
            "give points over the whole period, or fewer --harmonics"
        )
    cosines, sines = (
        coefficients[1 : harmonics + 1].tolist(),
        coefficients[harmonics + 1 :].tolist(),
    )
    fit = PathFit(k, tuple(cosines), tuple(sines), 0.0, 0.0)
    path = build(SimulatorConfig, fit.parameters["simulator"]).body
    build(ComputedTorqueConfig, fit.parameters["computed_torque"])
    heights = [path_height(position, 0.0, k, path.harmonics) for position in x.tolist()]
    residual = np.abs(y - coefficients[0] - np.array(heights))
    return fit._replace(rms=float(np.sqrt(np.mean(residual**2))), largest=float(residual.max()))
