import pytest
from ros2_ws.src.trunk_experiments.test.keys import ALICE, MALLORY, write_key

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.offline_recording import record_offline


@pytest.fixture(scope="session")
def original(tmp_path_factory):
    path = tmp_path_factory.mktemp("sign") / "run.mcap"
    record_offline(make_plan("fig8", "pid", everywhere={"duration": 0.05}), path)
    return path


@pytest.fixture
def run(original, tmp_path, monkeypatch):
    """Return a copy of a short run, in the working directory, with the keys alice and mallory."""
    monkeypatch.chdir(tmp_path)
    write_key(tmp_path / "alice", ALICE)
    write_key(tmp_path / "mallory", MALLORY)
    (tmp_path / "run.mcap").write_bytes(original.read_bytes())
    return tmp_path / "run.mcap"


@pytest.fixture
def signed(run, trunk):
    assert trunk("sign", "run.mcap", "--key", "alice")[0] == 0
    return run
