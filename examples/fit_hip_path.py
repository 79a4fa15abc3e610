"""Write the parameter file of the hip path that is nearest to measured points (docs/hardware.md).

    python examples/fit_hip_path.py GAIT.csv walk.yaml --harmonics 3

GAIT.csv has x and y of the hip in m, one point a line; lines that begin with # or x are headings. The period
is the distance from the first x to the last, unless --period gives it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray


def series(
    x: NDArray[np.float64], y: NDArray[np.float64], wavenumber: float, harmonics: int
) -> list[NDArray[np.float64]]:
    """Return the cosines and sines [m] of the least-squares series, and the residuals [m].

        y = c + sum over n = 1 ... harmonics of  a_n cos(n k x) + b_n sin(n k x),    k: wavenumber [rad/m]

    The mean height c is left out: it moves nothing. Raises ValueError for points that do not determine it.
    """
    waves = np.outer(wavenumber * x, np.arange(1, harmonics + 1))
    columns = np.hstack([np.ones((len(x), 1)), np.cos(waves), np.sin(waves)])
    coefficients, _, rank, _ = np.linalg.lstsq(columns, y, rcond=1e-6)
    if rank < columns.shape[1]:
        raise ValueError(
            f"the points determine {rank} of {columns.shape[1]} coefficients: give points over the whole "
            "period, or fewer --harmonics"
        )
    return [*np.split(coefficients[1:], 2), y - columns @ coefficients]


def main() -> None:
    """Read the points, and write the parameters of plant and model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("points", metavar="GAIT.csv", type=Path)
    parser.add_argument("output", metavar="PARAMETERS.yaml", type=Path)
    parser.add_argument("--harmonics", type=int, default=5)
    parser.add_argument("--period", type=float, help="in m")
    args = parser.parse_args()
    try:
        x, y = np.loadtxt(args.points, delimiter=",", comments=("#", "x"), ndmin=2, unpack=True)
        period = args.period or abs(x[-1] - x[0])
        if not period > 0.0:
            raise ValueError("the first x equals the last: give the path's --period in m")
        k = 2.0 * np.pi / float(period)
        cosines, sines, residuals = series(x, y, k, args.harmonics)
        parameters = {
            node: {
                "ros__parameters": {
                    f"{prefix}amplitude": 0.0,
                    f"{prefix}wavenumber": k,
                    f"{prefix}cosines": cosines.tolist(),
                    f"{prefix}sines": sines.tolist(),
                }
            }
            for node, prefix in (("simulator", "path."), ("computed_torque", "model.path_"))
        }
        with args.output.open("x", encoding="utf-8") as file:
            yaml.safe_dump(parameters, file, sort_keys=False)
    except (OSError, ValueError) as error:
        parser.error(f"{args.points}: {error}")
    print(f"{len(x)} points: {np.sqrt(np.mean(residuals**2)):.3g} m from the path (RMS)")


if __name__ == "__main__":
    main()
