"""The table of what varies: one row per run.

Row = ((grid point) x runs + draw) x controllers + controller: what is drawn, seeds included, depends
only on the draw, so that all controllers and all grid points meet the same conditions.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from .draws import stream
from .study import StudySpec


def design(study: StudySpec, first: int, last: int) -> dict[str, list[Any]]:
    """Return columns of the rows first <= row < last: run, controller, point, draw, seed, variables."""
    rows = np.arange(first, last)
    labels = [contender.label for contender in study.contenders]
    which = rows % len(labels)
    draw = rows // len(labels) % study.runs
    point = rows // (len(labels) * study.runs)
    drawn = drawn_values(study)
    places = np.unravel_index(point, study.shape) if study.shape else ()
    at = dict(zip((v.name for v in study.grid), places, strict=True))
    columns: dict[str, list[Any]] = {
        "run": rows.tolist(),
        "controller": [labels[i] for i in which],
        "point": point.tolist(),
        "draw": draw.tolist(),
        "seed": [drawn[""][i] if study.runs > 1 else None for i in draw],
    }
    for v in study.variables:
        chosen = v.values if v.distribution is None else drawn[v.name]
        columns[v.name] = [chosen[i] for i in at.get(v.name, draw)]
    return columns


@lru_cache(maxsize=1)
def drawn_values(study: StudySpec) -> dict[str, list[Any]]:
    """Return each drawn variable's values by name, and the noise seeds under an empty name."""
    values = {
        v.name: v.distribution.draw(study.runs, study.seed, v.name)
        for v in study.variables
        if v.distribution is not None
    }
    return {**values, "": stream(study.seed, "").integers(2**31, size=study.runs).tolist()}
