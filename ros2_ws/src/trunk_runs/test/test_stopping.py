"""The order in which a run's processes are stopped, and how long that takes, by a clock of the test."""

import signal

import pytest

from trunk_runs.processes import stop

PROMISE_S = 10.0  # docs/faults.md
NOTICED_S = 0.6  # a death is noticed, and heard out


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class Process:
    """Ends ``takes_s`` after SIGINT, and at once when it is killed."""

    pid = 0

    def __init__(self, clock: Clock, takes_s: float) -> None:
        self.clock, self.takes_s = clock, takes_s
        self.told: dict[int, float] = {}

    @property
    def ended(self) -> bool:
        told_s = self.told.get(signal.SIGINT)
        over = told_s is not None and self.clock() >= told_s + self.takes_s
        return over or signal.SIGKILL in self.told

    def signal(self, number: int) -> None:
        self.told.setdefault(number, self.clock())


HANGS = float("inf")


@pytest.mark.parametrize(
    ("first_s", "last_s", "killed"),
    [
        ((0.1, 0.2, 0.3), 0.5, []),
        ((3.5, 3.5, 3.5), 4.0, []),
        ((HANGS, 0.2, HANGS), 4.0, [0, 2]),
        ((0.1, 0.2, 0.3), HANGS, [3]),
        ((HANGS, HANGS, HANGS), HANGS, [0, 1, 2, 3]),
    ],
)
def test_all_are_stopped_at_once_and_the_recorder_last(
    first_s: tuple[float, ...], last_s: float, killed: list[int]
) -> None:
    clock = Clock()
    first = [Process(clock, takes_s) for takes_s in first_s]
    last = Process(clock, last_s)
    every = [*first, last]
    assert stop(first, [last], clock, clock.sleep) == [every[i] for i in killed]
    assert {process.told[signal.SIGINT] for process in first} == {0.0}
    assert last.told[signal.SIGINT] >= max(
        min(process.takes_s, process.told.get(signal.SIGKILL, HANGS)) for process in first
    )
    assert clock.now_s < PROMISE_S - NOTICED_S
