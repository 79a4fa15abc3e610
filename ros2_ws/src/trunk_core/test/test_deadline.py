"""A limit is in wall time, by the test's own clock, and TRUNK_PATIENCE multiplies it."""

import pytest

from trunk_core.deadline import Deadline


@pytest.mark.parametrize(("patience", "limit_s"), [("", 2.0), ("2.5", 5.0)])
def test_a_deadline_passes_once_nothing_was_heard_for_its_limit(monkeypatch, patience, limit_s):
    monkeypatch.setenv("TRUNK_PATIENCE", patience)
    now_s = 100.0
    deadline = Deadline(2.0, lambda: now_s)
    assert deadline.limit_s == limit_s
    for _ in range(3):
        now_s += limit_s
        assert not deadline.passed
        deadline.restart()
    now_s += limit_s + 0.001
    assert deadline.passed
