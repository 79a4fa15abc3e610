"""The controllers' replay of messages that hold less or more than ours: step by step, or refused."""

from __future__ import annotations

import pytest

from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.driven import driven_controllers
from trunk_experiments.replay.replay import replay_controllers
from trunk_msgs_util.recording.joint_state_cdr import layout_of
from trunk_msgs_util.recording.reader import RecordingError
from trunk_msgs_util.samples import JointSample

from ..edited import NONE, copied
from .runs import STATES, of, planned, recorded


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return recorded(planned(), tmp_path_factory.mktemp("replay") / "plain.mcap")


def reshaped(path, topic, change):
    """Return the run with each message of a topic changed: ``change(names, position, velocity, effort)``."""
    table = RecordedRun.open(path).table(topic)
    rows = [
        [table.values(quantity)[row].tolist() for quantity in ("position", "velocity", "effort")]
        for row in range(len(table))
    ]

    def edit(messages):
        for message, stamp_ns, row in zip(of(messages, topic), table.stamps, rows, strict=True):
            names, *values = change(list(table.names), *row)
            sample = JointSample(stamp_ns, tuple(names), *values)
            message[2] = layout_of(sample).pack(sample)

    return RecordedRun(copied(path, path.with_suffix(".reshaped"), edit, NONE))


def checked(run):
    return list(replay_controllers(run, driven_controllers(run)))


def test_states_without_torques_are_checked_one_by_one(plain):
    run = reshaped(plain, "joint_states", lambda names, p, v, e: (names, p, v, ()))
    found = checked(run)
    assert [one.steps for one in found] == [1] * STATES
    assert [d for one in found for d in one.found] == []


@pytest.mark.parametrize(
    ("topic", "change", "told"),
    [
        (
            "effort_command",
            lambda names, p, v, e: ([*names, "other"], p, v, [*e, 0.0]),
            "2 values of effort for 2 names at t = 0 s, 1 are needed",
        ),
        ("effort_command", lambda names, p, v, e: (names, p, v, ()), "0 values of effort"),
        (
            "pid/state",
            lambda names, p, v, e: (names[:-1], p[:-1], v, e),
            r"(\d+) values of position for \1 names",
        ),
    ],
    ids=["two torques", "no torque", "a term too few"],
)
def test_what_cannot_be_compared_is_refused(plain, topic, change, told):
    with pytest.raises(RecordingError, match=told):
        checked(reshaped(plain, topic, change))
