"""A reference and a disturbance from tables, and random pulses: a changed value is found by verify."""

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, content, write

from trunk_evidence.judgement import verify
from trunk_evidence.verdict import VERIFIED
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from .tampering.edits import PARAMETERS, at, every, fields, on, to

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


def one_ulp(values):
    return np.array([*values[:-1], np.nextafter(values[-1], np.inf)])


EDITS = {
    "reference.values": ("double_array_value", one_ulp),
    "reference.times": ("double_array_value", one_ulp),
    "reference.profile": ("string_value", to("sequence")),
    "table.values": ("double_array_value", one_ulp),
    "table.times": ("double_array_value", one_ulp),
    "table.interpolation": ("string_value", to("hold")),
    "pulse.random_seed": ("integer_value", lambda value: value + 1),
    "pulse.random_count": ("integer_value", lambda value: value + 1),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", EDITS)
def test_another_value_is_found(whole, tmp_path, name):
    field, change = EDITS[name]
    edited = at(f"value.{field}", change)
    alter = at("new_parameters.*", lambda given: edited(given) if given.name == name else given)
    recorded = content(whole)
    on(PARAMETERS, every, fields(alter))(recorded)
    assert recorded != content(whole)
    judged = verify(write(recorded, tmp_path / "edited.mcap", ANEW)).exit_code
    # An ULP of 0.2 s is less than half a nanosecond: the same stamps, and the same run.
    assert (judged == VERIFIED) == name.endswith("times")
