"""What ``trunk tune optimise --study`` prints of draws that the search did not see."""

from __future__ import annotations

from math import isfinite

from ...console.tables import print_table
from ...study.compare import PairedDifference, estimate_text, number_text, percent
from ...study.learning import Learned
from .document import LearnedDifference, StudySearchResult


def differences(learned: Learned, metric: str) -> list[PairedDifference]:
    """Return the learned parameters' metric minus that of each other contender, held-out draws."""
    _, new, *_ = learned.held_out
    return [new.less(other, metric) for other in learned.held_out if other is not new]


def show(learned: Learned, metric: str, seed: int) -> None:
    """Print falls, means and paired differences."""
    rows = []
    for draws, outcomes in (("searched", learned.searched), (f"seed {seed}", learned.held_out)):
        for o in outcomes:
            share = f"{percent(o.share.value)} [{percent(o.share.low)}…{percent(o.share.high)}]"
            mean = number_text(o.mean) if isfinite(o.mean) else ""
            rows.append((o.controller, draws, f"{o.fell} of {o.runs}", share, mean))
    print_table(
        "falls with Wilson's intervals, and the mean over the runs that stood",
        ("controller", "draws", "fell", "share", metric),
        rows,
        texts=2,
    )
    print_table(
        f"{metric} on held-out draws, learned minus other, where both stood",
        ("other", "pairs", "mean difference", "smaller"),
        [
            (d.second, str(d.pairs), estimate_text(d.mean_with_bounds), d.verdict)
            for d in differences(learned, metric)
        ],
    )


def study_result(learned: Learned, source: str, metric: str, seed: int) -> StudySearchResult:
    """Return the same for the document."""
    rows = [
        LearnedDifference(d.second, d.pairs, d.mean_with_bounds, d.verdict)
        for d in differences(learned, metric)
    ]
    return StudySearchResult(
        source, learned.fall_costs, seed, learned.searched, learned.held_out, rows
    )
