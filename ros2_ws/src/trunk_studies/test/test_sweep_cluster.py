"""Blocks on a Dask cluster of two worker processes, one of them killed: the same bytes."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from trunk_core.errors import StudyError
from trunk_studies import sweep_execution as sweep_cluster
from trunk_studies.study import parse_study
from trunk_studies.sweep_execution import SweepJob, dask_runner, processes

distributed = pytest.importorskip("distributed")

HUNG_S = 600  # as long as pytest waits for a test

STUDY = """
scenario: fig6
rate: 1000
set: {simulator.substeps: 1}
duration: 1.0
controllers: [pid]
block: 5
vary:
  delay: {parameter: simulator.sensor.delay, from: 0.0, to: 0.02, steps: 40}
"""


@pytest.fixture(scope="module")
def study():
    return parse_study(STUDY, "study.yaml")


@pytest.fixture
def cluster(tmp_path):
    """Yield a scheduler's address and two workers, each in its own process."""
    environment = {**os.environ, "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{HUNG_S}s"}
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1"]
    file = tmp_path / "scheduler.json"
    command += ["--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    started = [subprocess.Popen(command, **quiet)]
    try:
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-nanny"]
        worker += ["--nthreads", "1", "--no-dashboard", "--scheduler-file", str(file)]
        worker += ["--local-directory", str(tmp_path)]
        started += [subprocess.Popen(worker, **quiet) for _ in range(2)]
        while not described(file):
            assert started[0].poll() is None
            time.sleep(0.05)
        with distributed.Client(scheduler_file=str(file), timeout=HUNG_S) as client:
            client.wait_for_workers(2, timeout=HUNG_S)
            address = client.scheduler.address
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


def described(file):
    """Return True once the scheduler has written its file to the end."""
    with suppress(OSError, ValueError):
        return "address" in json.loads(file.read_text())
    return False


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_the_loss_of_a_worker_changes_nothing(study, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_cluster, "_CONNECT_S", HUNG_S)
    address, workers = cluster
    path = tmp_path / "cluster.parquet"
    sweep = SweepJob(study, path)
    sweep.start()
    finished = []

    def progress(done, of):
        finished.append(done)
        if len(finished) == 3:
            os.kill(workers[0].pid, signal.SIGKILL)

    sweep.run(dask_runner(address), progress)
    assert workers[0].wait() == -signal.SIGKILL
    assert finished[-1] == study.total == 40
    sweep.finish()
    plain = SweepJob(study, tmp_path / "plain.parquet")
    plain.start()
    plain.run(processes(1))
    plain.finish()
    assert path.read_bytes() == plain.output.read_bytes()


def test_a_missing_scheduler_gives_one_line(monkeypatch):
    monkeypatch.setattr(sweep_cluster, "_CONNECT_S", 0.5)
    with pytest.raises(StudyError, match=r"--scheduler tcp://127.0.0.1:9: no scheduler answers"):
        list(dask_runner("tcp://127.0.0.1:9")([]))
    with pytest.raises(StudyError, match=r"--scheduler nonsense://: no scheduler answers"):
        list(dask_runner("nonsense://")([]))


def test_without_dask_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(StudyError, match=r"pip install -r requirements/cluster\.txt"):
        dask_runner("tcp://127.0.0.1:9")
