"""The document of ``trunk tune``, whose members take long to load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

from trunk_core.results import Count, Result
from trunk_studies.statistics import DrawnRuns, Estimate
from trunk_studies.tuning.methods import Relay
from trunk_studies.tuning.stability_margins import LoopMargins


class SearchResult(NamedTuple):
    """The metric's mean before and after a search."""

    metric: str
    scenarios: Sequence[str]
    before: float
    after: float
    runs: Count
    seed: Count


class LearnedDifference(NamedTuple):
    """A metric of the learned parameters minus that of others, on held-out draws where both stood."""

    other: str
    pairs: Count
    mean: Estimate
    verdict: str


class StudySearchResult(NamedTuple):
    """A search on draws of a study, judged on others."""

    file: str
    fall_costs: Annotated[float, "Of a fall"]
    held_out_seed: Count
    searched: Sequence[DrawnRuns]
    held_out: Sequence[DrawnRuns]
    differences: Sequence[LearnedDifference]


@dataclass(frozen=True)
class TuneResult(Result, document="tune-1"):
    """The document of ``trunk tune METHOD``."""

    controller: str
    output: Annotated[Path | None, "The parameter file; null: none asked for"]
    parameters: Mapping[str, object]
    update_rate_hz: float
    margins: Annotated[Sequence[LoopMargins], "About the upright; also at corners of a gain box"]
    relay: Annotated[Relay | None, "tune relay: Ku in N m/rad, Tu in s, rad"] = None
    search: Annotated[SearchResult | None, "tune optimise: the metric's mean"] = None
    study: Annotated[StudySearchResult | None, "tune optimise --study: also on other draws"] = None
