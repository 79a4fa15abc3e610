"""Parameters and readings off the beaten track, for exported controllers."""

import math
import random
from collections.abc import Iterator

from trunk_control.decide import Reading
from trunk_control.law import Hip

CHANGES: dict[str, dict[str, object]] = {
    "fuzzy_pid": {"consequents": "log"},
    "pid": {"antiwindup_strategy": "back_calculation", "derivative_filter_time": 0.02},
    "lqr": {"reference_profile": "sine", "reference_amplitude": 0.2, "reference_frequency": 0.7},
    "computed_torque": {"derivative_mode": "error", "cosines": (0.1, 0.0), "sines": (0.0, 0.05)},
    "state_feedback": {"x": -3.0, "v": -2.0, "p": -40.0, "derivative_mode": "measurement"},
    "fuzzy": {"form": "pi", "antiwindup_strategy": "back_calculation"},
}


def readings(rng: random.Random, count: int) -> Iterator[Reading]:
    """Yield readings: regular ones, jumps of the time, numbers that are not finite, references by topic."""
    stamp_ns = 0
    for _ in range(count):
        stamp_ns += rng.choice(
            (
                5_000_000,
                5_000_000,
                1_000_000,
                4_950_000,
                5_050_000,
                1_700_000,
                700_000_000,
                -3_000_000,
            )
        )
        numbers = [rng.uniform(-1.0, 1.0) for _ in range(6)]
        if rng.random() < 0.1:
            numbers[rng.randrange(6)] = rng.choice(
                (math.nan, math.inf, -math.inf, -0.0, 1e300, 5e-324, 40.0)
            )
        position, rate, x, v, acting, reference = numbers
        by_topic = rng.random() < 0.5
        yield Reading(stamp_ns, position, 4.0 * rate, Hip(x, v), 20.0 * acting, by_topic, reference)
