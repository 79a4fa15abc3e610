"""The samples that a law is tried with: the same in every run of a check."""

from __future__ import annotations

from itertools import product
from math import inf, nan

from trunk_control.law import Hip, Sample
from trunk_msgs_util.elementary import cos, sin

DT = 0.005
STILL = Hip(0.0, 0.0)
_LARGE = 1e308
_EXTREMES = (0.0, -50.0, nan, inf, -inf, _LARGE, -_LARGE, 5e-324)


def swinging(duration: float, dt: float = DT, amplitude: float = 0.3) -> list[Sample]:
    """Return smooth samples of a trunk that swings at 1 Hz around a reference of 0.1 rad."""
    turn = 6.283185307179586
    samples = []
    for k in range(round(duration / dt)):
        angle = turn * k * dt
        hip = Hip(0.2 * k * dt, 0.2)
        samples.append(Sample(0.1, amplitude * sin(angle), amplitude * turn * cos(angle), dt, hip))
    return samples


def steady(count: int, dt: float = DT) -> list[Sample]:
    """Return samples of a trunk at rest, 0.2 rad from its reference."""
    return [Sample(0.2, 0.0, 0.0, dt, STILL)] * count


def unusable() -> list[Sample]:
    """Return samples with at least one input that is not finite, or whose time does not advance."""
    samples = [
        Sample(r, y, w, dt, STILL)
        for r, y, w, dt in product((0.0, nan, inf), (0.1, nan, -inf), (0.0, nan, inf), (DT, 0.0))
    ]
    samples += [Sample(0.0, 0.1, 0.0, -DT, STILL), Sample(0.0, 0.1, 0.0, nan, STILL)]
    usable = Sample(0.0, 0.1, 0.0, DT, STILL)
    return [sample for sample in samples if sample != usable]


def extreme() -> list[Sample]:
    """Return samples of extreme numbers: some overflow in any law."""
    return [
        Sample(r, y, w, dt, STILL)
        for r, y, w, dt in product(_EXTREMES, _EXTREMES, _EXTREMES, (DT, 1e308, 5e-324, 0.0))
    ]
