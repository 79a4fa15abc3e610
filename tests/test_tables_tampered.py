"""A reference and a disturbance from tables, and random pulses: a changed value is found by verify."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from ros2_ws.src.trunk_msgs_util.test.mcap_files import ANEW, copied

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.replay.verdict import VERIFIED
from trunk_experiments.replay.verify import verify
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util.recording.reader import Recording

from .tampering.messages import PARAMETERS, TOPIC, parsed, store

SETTINGS = [
    "pid.reference.profile=interpolated",
    "pid.reference.times=[0.1, 0.3]",
    "pid.reference.values=[0.1, -0.2]",
    "disturbance.table.times=[0.1, 0.2]",
    "disturbance.table.values=[1.0, 2.0]",
    "disturbance.pulse.start_times=[]",
    "disturbance.pulse.random_count=2",
    "disturbance.pulse.random_until=0.3",
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "whole.mcap"
    plan = make_plan("demo", "pid", settings=SETTINGS, everywhere={"duration": 0.4})
    record_offline(plan, path)
    assert verify(Recording.open(path)).exit_code == VERIFIED
    return path


def one_ulp(value):
    *first, last = value.double_array_value
    value.double_array_value = np.array([*first, np.nextafter(last, np.inf)])


def one_more(value):
    value.integer_value += 1


def hold(value):
    value.string_value = "hold"


def sequence(value):
    value.string_value = "sequence"


EDITS = {
    "reference.values": one_ulp,
    "reference.times": one_ulp,
    "reference.profile": sequence,
    "table.values": one_ulp,
    "table.times": one_ulp,
    "table.interpolation": hold,
    "pulse.random_seed": one_more,
    "pulse.random_count": one_more,
}


def edit(name, messages):
    for message in messages:
        if message[TOPIC] == PARAMETERS:
            event = parsed(message)
            found = [one for one in event.new_parameters if one.name == name]
            if found:
                EDITS[name](found[0].value)
                store(message, event)
                return
    raise AssertionError(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", EDITS)
def test_another_value_is_found(whole, tmp_path, name):
    copy = copied(whole, tmp_path / "edited.mcap", partial(edit, name), digests=ANEW)
    found = verify(copy).exit_code
    # An ULP of 0.2 s is less than half a nanosecond: the same stamps, and the same run.
    assert (found == VERIFIED) == name.endswith("times")
