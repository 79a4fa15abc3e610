"""What ``trunk tune optimise --study`` prints of draws that the search did not see."""

from __future__ import annotations

from math import isfinite
from typing import Any

from ...console.tables import print_table
from ...study.compare import Estimate, MeanDifference, estimate_text, number_text, percent
from ...study.learning import DrawnRuns, LearningOutcome


def differences(learned: LearningOutcome, metric: str) -> list[MeanDifference]:
    """Return the learned parameters' metric minus that of each other contender, held-out draws."""
    _, new, *_ = learned.held_out
    return [new.less(other, metric) for other in learned.held_out if other is not new]


def show(learned: LearningOutcome, metric: str, seed: int) -> None:
    """Print falls, means and paired differences."""
    rows = []
    for draws, outcomes in (("searched", learned.trained), (f"seed {seed}", learned.held_out)):
        for o in outcomes:
            share = f"{percent(o.share.value)} [{percent(o.share.low)}…{percent(o.share.high)}]"
            mean = number_text(o.mean) if isfinite(o.mean) else ""
            rows.append((o.label, draws, f"{o.fell} of {len(o.metric)}", share, mean))
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


def as_values(learned: LearningOutcome, source: str, metric: str, seed: int) -> dict[str, Any]:
    """Return the same as plain values; None for what does not exist."""
    return {
        "file": source,
        "fall_costs": learned.fall,
        "held_out_seed": seed,
        "searched": [_outcome(o) for o in learned.trained],
        "held_out": [_outcome(o) for o in learned.held_out],
        "differences": [
            {
                "other": d.second,
                "pairs": d.pairs,
                "mean": _estimate(d.mean_with_bounds),
                "verdict": d.verdict,
            }
            for d in differences(learned, metric)
        ],
    }


def _outcome(o: DrawnRuns) -> dict[str, Any]:
    mean = o.mean if isfinite(o.mean) else None
    return {
        "controller": o.label,
        "fell": o.fell,
        "runs": len(o.metric),
        "share": _estimate(o.share),
        "mean": mean,
    }


def _estimate(estimate: Estimate) -> dict[str, float | None]:
    return {name: value if isfinite(value) else None for name, value in estimate._asdict().items()}
