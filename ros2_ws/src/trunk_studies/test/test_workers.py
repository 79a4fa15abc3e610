"""Worker processes: a bounded number of tasks in flight, and workers that die."""

import os
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import count, islice

import pytest

from trunk_core.errors import SweepError
from trunk_studies import sweep_execution as module
from trunk_studies.batch import workers
from trunk_studies.study import parse_study
from trunk_studies.sweep_execution import SweepJob, processes

STUDY = """
scenario: fig6
rate: 200
duration: 0.2
controllers: [pid]
block: 1
vary:
  delay: {parameter: simulator.sensor.delay, from: 0.0, to: 0.1, steps: 50}
"""


def _one_thread(_count):
    """Return a pool of one thread: compilation is not thread-safe."""
    return ThreadPoolExecutor(1)


@pytest.fixture
def sweep(tmp_path):
    made = SweepJob(parse_study(STUDY, "study.yaml"), tmp_path / "out.parquet")
    made.start()
    return made


def test_endless_items_are_taken_on_demand():
    taken = []

    def items():
        for i in count():
            taken.append(i)
            yield i

    results = workers.as_completed_bounded(ThreadPoolExecutor(2), lambda i: 2 * i, items(), 5)
    assert len({result // 2 for result in islice(results, 20)}) == 20
    assert len(taken) <= 20 + 5
    results.close()


def test_there_is_a_worker_for_each_core_that_may_be_used(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {3})
    assert workers.cores() == 1


@pytest.mark.slow
def test_blocks_are_made_on_demand(sweep, monkeypatch):
    monkeypatch.setattr(module, "worker_pool", _one_thread)
    taken = []

    def blocks():
        for block in sweep.waiting():
            taken.append(block.index)
            yield block

    results = processes(2)(blocks())
    next(results)
    assert len(taken) < 10
    assert sorted([0, *(index for index, _ in results)])[-1] == 49


class _Broken(ThreadPoolExecutor):
    """A pool whose processes died before the second task arrived."""

    submitted = 0

    def __init__(self, _count):
        super().__init__(1)

    def submit(self, *arguments, **named):
        self.submitted += 1
        if self.submitted > 1:
            raise BrokenProcessPool("a child process terminated abruptly")
        return super().submit(*arguments, **named)


def test_a_pool_that_breaks_while_being_filled_gives_one_line(sweep, monkeypatch):
    monkeypatch.setattr(module, "worker_pool", _Broken)
    with pytest.raises(SweepError, match=r"a worker process was killed .* run the same command"):
        sweep.run(processes(2))


def test_a_killed_worker_gives_one_line(sweep, monkeypatch):
    monkeypatch.setattr(workers, "_end_with_parent", os._exit)  # its missing argument ends a worker
    with pytest.raises(SweepError, match="a worker process was killed"):
        sweep.run(processes(2))


def _no_memory(block):
    raise MemoryError


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_run_without_memory_gives_one_line(sweep, monkeypatch, jobs):
    monkeypatch.setattr(module, "worker_pool", _one_thread)
    monkeypatch.setattr(module, "run_block", _no_memory)
    with pytest.raises(SweepError, match="not enough memory"):
        sweep.run(processes(jobs))
