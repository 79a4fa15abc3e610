"""What acted on the plant and is not on record, in whatever order rows and messages arrive."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_msgs_util import completeness
from trunk_msgs_util.completeness import ActedRecord
from trunk_msgs_util.source import frame_of_inputs

MS = 1_000_000
PLANT, PID, LQR, PUSH = (f"{name}@boot.{k}.1" for k, name in enumerate(("sim", "pid", "lqr", "d")))
COMMAND = topics.EFFORT_COMMAND


def row(stamp_ns, command=(-1, ""), disturbance=(-1, "")):
    """Return a row and its frame; a stamp of -1: nothing is in force."""
    ages = [-1.0 if at < 0 else float(stamp_ns - at) for at, _ in (command, disturbance)]
    sample = JointSample(stamp_ns, topics.INPUT_NAMES, (0.0,) * 5, (ages[0], *[ages[1]] * 4))
    return sample, frame_of_inputs(PLANT, command[1], disturbance[1])


def line(topic, sender, at, more=""):
    acted = f"a message of {sender} acted on the plant, stamped t = {at} s"
    return f"{topic}: {acted}, but was not recorded{more}"


def test_what_acted_is_on_record():
    found = ActedRecord()
    found.record(COMMAND, 0, PID)
    found.record(topics.DISTURBANCE, 0, PUSH)
    found.record(topics.JOINT_STATES, 0, PLANT)
    for k in range(3):
        found.row(*row(k * MS, (0, PID), (0, PUSH)))
    assert list(found.missing()) == []


def test_each_topic_that_lacks_something_is_named_with_the_first_of_it():
    found = ActedRecord()
    found.record(COMMAND, 2 * MS, "")  # of a stranger
    for k in range(5):
        found.row(*row(k * MS, (k * MS, PID if k < 2 else ""), (k * MS if k > 2 else -1, "")))
    assert list(found.missing()) == [
        line(topics.EFFORT_COMMAND, PID, "0", " (and 3 more)"),
        line(topics.DISTURBANCE, "a node that is not ours", "0.003", " (and 1 more)"),
    ]


def test_another_sources_message_of_the_stamp_is_another_message():
    found = ActedRecord()
    found.record(COMMAND, 0, LQR)
    found.row(*row(0, (0, PID)))
    assert list(found.missing()) == [line(COMMAND, PID, "0")]


@given(st.data())
def test_the_order_of_arrival_does_not_matter(data):
    """Against an oracle: every message that a row names, and that is not recorded, is missing."""
    in_force = []
    now = (-1, "")
    for k in range(data.draw(st.integers(1, 12))):
        if data.draw(st.booleans()) and now[0] < k * MS:
            now = (k * MS, data.draw(st.sampled_from([PID, LQR, ""])))
        in_force.append(data.draw(st.sampled_from([now, (-1, "")])))
    sent = sorted({*in_force, *((k * MS, LQR) for k in range(12))} - {(-1, "")})
    lost = data.draw(st.sets(st.sampled_from(sent)))
    recorded = [key for key in sent if key not in lost]
    arrivals = [True] * len(in_force) + [False] * len(recorded)
    rows, messages = iter(enumerate(in_force)), iter(recorded)
    found = ActedRecord()
    for is_row in data.draw(st.permutations(arrivals)):
        if is_row:
            k, command = next(rows)
            found.row(*row(k * MS, command))
        else:
            found.record(COMMAND, *next(messages))
    missing = sorted(lost & set(in_force))
    lines = list(found.missing())
    assert len(lines) == bool(missing)
    if missing:
        stamp_ns, source = missing[0]
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        sender = source or "a node that is not ours"
        assert lines == [line(COMMAND, sender, f"{stamp_ns / 1e9:g}", more)]


def test_it_remembers_no_more_than_it_needs(monkeypatch):
    monkeypatch.setattr(completeness, "_REMEMBERED", 10)
    found = ActedRecord()
    for k in range(1000):
        found.record(COMMAND, k * MS, PID)
        found.row(*row(k * MS, (k * MS, PID)))
    (commands, _) = found._topics.values()
    assert (len(commands._recorded), len(commands._missing)) == (10, 0)
    for k in range(1000):  # of a controller whose commands never act
        found.record(COMMAND, (k + 2000) * MS, LQR)
        found.row(*row((k + 2000) * MS, (k * MS, "")))
    assert len(commands._recorded) == len(commands._missing) == 10


@pytest.mark.parametrize(
    ("sample", "frame"),
    [
        (row(0)[0], ""),
        (row(0)[0], PLANT),
        (row(0)[0]._replace(name=("trunk",)), row(0)[1]),
        (row(0)[0]._replace(velocity=()), row(0)[1]),
    ],
)
def test_what_no_simulator_sends_is_no_row(sample, frame):
    with pytest.raises(ValueError, match="not a row"):
        ActedRecord().row(sample, frame)
