"""A process is known by more than its number, which another one may have later or on another machine."""

import os
import subprocess
import sys

from trunk_msgs_util.source import is_older, local_pid, process_id


def test_each_process_has_its_own_id_which_leads_back_to_it():
    mine = process_id()
    assert mine == process_id(os.getpid())
    assert local_pid(mine) == os.getpid()
    assert mine != process_id(os.getppid())


def test_a_process_that_becomes_another_program_keeps_its_id():
    code = "from trunk_msgs_util.source import process_id; print(process_id())"
    child = subprocess.Popen(
        ["/bin/sh", "-c", 'read go; exec "$@"', "sh", sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    before = process_id(child.pid)
    assert child.communicate("go\n")[0].strip() == before != ""
    assert local_pid(before) is None


def test_an_id_that_does_not_exist_here_finds_no_process():
    boot, pid, start = process_id().split(".")
    for other in (
        "",
        "x",
        f"{boot}.{pid}",
        f"{boot}.{pid}.{int(start) + 1}",
        f"other.{pid}.{start}",
    ):
        assert local_pid(other) is None
    assert process_id(2**22 + 1) == ""


def test_the_older_of_two_processes_was_started_earlier():
    child = subprocess.Popen(["/bin/sleep", "60"])
    try:
        mine, other = process_id(), process_id(child.pid)
        assert is_older(mine, other)
        assert is_older(other, mine) is False
    finally:
        child.kill()
        child.wait()
    assert is_older("boot.9.100", "boot.8.100") is False, "numbers count within one tick"
    assert is_older("boot.8.100", "boot.9.100")
    assert is_older("boot.80.99", "boot.9.100")


def test_of_processes_on_two_machines_neither_is_older():
    for one, other in (("a.1.2", "b.3.4"), ("", "a.1.2"), ("a.1", "a.1.2"), ("a.1.x", "a.1.2")):
        assert is_older(one, other) is None
        assert is_older(other, one) is None
