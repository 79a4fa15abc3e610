"""A limit counts the time in which a process could have answered; clocks and readings are the test's own."""

import os

import pytest

from trunk_msgs_util import cpu_deadline
from trunk_msgs_util.cpu_deadline import (
    CpuDeadline,
    Thread,
    Threads,
    scheduling_delay_ns,
    threads_of,
)

MS = 1_000_000
LOOK_S = 0.05


class Machine:
    """A clock and the threads of one process; each step of 50 ms is spent in one way."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.thread = Thread(0, 0, "S")

    def clock(self) -> float:
        return self.now_s

    def look(self, pid: int) -> Threads:
        return {pid: self.thread}

    def spend(self, run_ms: int = 0, delay_ms: int = 0, state: str = "S") -> None:
        self.now_s += LOOK_S
        run, delay, _ = self.thread
        self.thread = Thread(run + run_ms * MS, delay + delay_ms * MS, state)


def steps_until_spent(limit_s: float, **way: object) -> int:
    machine = Machine()
    deadline = CpuDeadline(limit_s, machine.clock, machine.look)
    for step in range(1, 2000):
        machine.spend(**way)
        if deadline.spent([7]):
            return step
    return 0


@pytest.mark.parametrize("state", ["S", "T", "Z"])
def test_a_sleeping_or_stopped_process_is_given_up_at_the_limit(state: str) -> None:
    assert steps_until_spent(5.0, state=state) == pytest.approx(100, abs=1)


def test_an_endless_loop_is_given_up_at_the_limit() -> None:
    assert steps_until_spent(5.0, run_ms=50, state="R") == pytest.approx(100, abs=1)


def test_a_process_that_waits_for_a_processor_half_of_the_time_gets_longer() -> None:
    steps = steps_until_spent(6.0, run_ms=25, delay_ms=25, state="R")
    assert steps == pytest.approx(40 + 2 * 80, abs=2)  # the first third is counted without a look


@pytest.mark.parametrize("way", [{"delay_ms": 50}, {"state": "R"}, {"state": "D"}], ids=str)
def test_a_process_without_a_processor_or_waiting_for_the_disk_is_not_given_up(way: dict) -> None:
    assert steps_until_spent(5.0, **way) == 0


def test_a_gap_between_two_looks_is_the_observers_and_does_not_count() -> None:
    machine = Machine()
    deadline = CpuDeadline(1.0, machine.clock, machine.look)
    machine.now_s += 3600.0
    assert not deadline.spent([7])
    machine.now_s += 0.5
    assert not deadline.spent([7])


def test_a_sign_of_life_restarts_the_wait() -> None:
    machine = Machine()
    deadline = CpuDeadline(1.0, machine.clock, machine.look)
    for _ in range(100):
        machine.spend()
        assert not deadline.spent([7])
        if machine.now_s % 0.5 < LOOK_S:
            deadline.restart()


def test_the_thread_that_was_held_up_longest_counts() -> None:
    before = {1: Thread(0, 0, "S"), 2: Thread(0, 0, "S")}
    now = {1: Thread(0, 10 * MS, "S"), 2: Thread(0, 30 * MS, "S"), 3: Thread(0, 40 * MS, "S")}
    assert (
        scheduling_delay_ns(before, now, 50 * MS) == 30 * MS
    )  # 3 is new: nothing is known of its past
    assert scheduling_delay_ns(before, now, 20 * MS) == 20 * MS


def test_linux_reports_this_process_and_nothing_for_one_that_does_not_exist() -> None:
    mine = threads_of(os.getpid())
    if mine:  # where there is no schedstat, wall time counts
        assert mine[os.getpid()].run_ns > 0
        assert mine[os.getpid()].state == ""  # it is running as it looks
    assert threads_of(2**22 + 1) == {}


def test_the_fields_of_linux_are_told_apart(tmp_path, monkeypatch) -> None:
    (task := tmp_path / "7").mkdir()
    (task / "schedstat").write_text("5 3 1\n")
    (task / "stat").write_text("7 (a) S) D 1 2\n")
    monkeypatch.setattr(cpu_deadline, "Path", lambda _: tmp_path)
    assert threads_of(1) == {7: Thread(run_ns=5, delay_ns=3, state="D")}
