"""A name that one process holds: until it ends, however it ends."""

import os
import subprocess
import sys
import uuid

import pytest

from trunk_msgs_util.source import HeldError, claimed

HOLD = """
import sys
from trunk_msgs_util.source import claimed
token = claimed(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def name():
    return f"node /pid {uuid.uuid4()}"


def holder_of(name):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, name],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_another_process_is_refused_and_told_who_holds_the_name(name):
    with holder_of(name) as holder:
        with pytest.raises(HeldError, match=f"^{holder.pid}$"):
            claimed(name)
        claimed(f"{name} and more").close()
        holder.kill()
    claimed(name).close()


def test_the_process_that_holds_it_may_claim_it_again(name):
    with claimed(name), claimed(name):
        pass
    with holder_of(name) as holder:
        holder.kill()
