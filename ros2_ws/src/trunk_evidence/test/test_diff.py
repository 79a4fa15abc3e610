"""`diff`: stamps that appear more than once, and whether differences are in ULPs or in units."""

import pytest

from trunk_core import topics
from trunk_core.samples import JointSample
from trunk_evidence.differences import FirstDifference, diff
from trunk_evidence.recorded_run import RecordedRun
from trunk_recording.cdr import layout_of
from trunk_recording.writer import RecordingWriter
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_sim.plant import PLANTS

MS = 1_000_000


def run(path, *messages):
    """Record (stamp in ms, torque) as commands; a bare stamp is its own torque."""
    with RecordingWriter(path) as writer:
        channel = writer.channel(f"/{topics.EFFORT_COMMAND}", topics.JOINT_STATE_TYPE)
        for message in messages:
            stamp, torque = message if isinstance(message, tuple) else (message, message)
            sample = JointSample(stamp * MS, ("trunk",), effort=(float(torque),))
            writer.write(channel, stamp * MS, stamp * MS, layout_of(sample).pack(sample))
    return RecordedRun.open(path)


CASES = {
    "doubled in A": ((0, 1, 1, 2), (0, 1, 2), 1, (1.0, None)),
    "doubled in B": ((0, 1, 2), (0, 1, 2, 2), 2, (None, 1.0)),
    "three times against twice": ((0, 1, 1, 1, 2), (0, 1, 1, 2), 1, (1.0, None)),
    "as many, but of other stamps": ((0, 1, 1, 2), (0, 1, 2, 2), 1, (1.0, None)),
    "the second of a stamp": ((0, (1, 5.0), (1, 6.0)), (0, (1, 5.0), (1, 7.0)), 1, (6.0, 7.0)),
}


@pytest.mark.parametrize(("a", "b", "stamp", "values"), CASES.values(), ids=CASES)
def test_every_message_of_a_stamp_counts(tmp_path, a, b, stamp, values):
    found = diff(run(tmp_path / "a.mcap", *a), run(tmp_path / "b.mcap", *b))
    assert not found.identical
    assert found.first.stamp_ns == stamp * MS
    assert (found.first.a, found.first.b) == values
    assert found.first.topic == topics.EFFORT_COMMAND


def test_equal_doubled_stamps_do_not_differ(tmp_path):
    stamps = (0, 1, 1, 2, (2, 7.0))
    found = diff(run(tmp_path / "a.mcap", *stamps), run(tmp_path / "b.mcap", *stamps))
    assert found.identical
    assert (found.compared, found.differing_steps) == (5, 0)


@pytest.mark.parametrize(
    ("here", "there", "says"),
    [
        ({"position": (1.0,)}, {}, "position[trunk]: only in A"),
        ({}, {"position": (1.0,)}, "position[trunk]: only in B"),
        ({}, {"name": ("t",)}, "name: trunk in A, t in B"),
    ],
)
def test_what_only_one_run_has_is_told_of_that_run(tmp_path, here, there, says):
    runs = []
    for letter, values in (("a", here), ("b", there)):
        sample = JointSample(0, **{"name": ("trunk",), "effort": (1.0,), **values})
        with RecordingWriter(tmp_path / f"{letter}.mcap") as writer:
            channel = writer.channel(f"/{topics.EFFORT_COMMAND}", topics.JOINT_STATE_TYPE)
            writer.write(channel, 0, 0, layout_of(sample).pack(sample))
        runs.append(RecordedRun.open(tmp_path / f"{letter}.mcap"))
    found = diff(*runs)
    assert found.describe() == f"t = 0 s: effort_command: {says}"
    assert found.differing_steps == 1


def planned(path, *settings, controller="pid"):
    plan = make_plan("fig6", controller, settings=["simulator.duration=0.1", *settings])
    record_offline(plan, path)
    return RecordedRun.open(path)


def test_only_runs_of_the_same_plan_are_compared_in_ulps(tmp_path):
    first = planned(tmp_path / "a.mcap")
    again = planned(tmp_path / "b.mcap", "simulator.command_timeout=0.3", "simulator.duration=0.05")
    assert diff(first, again).same_plan
    for i, other in enumerate(
        ("simulator.plant.gravity=9.82", "simulator.initial.position=[0.0, 0.6]")
    ):
        found = diff(first, planned(tmp_path / f"{i}.mcap", other))
        assert not found.same_plan
        assert " ULP" not in found.describe()
    assert found.describe() == (
        "t = 0 s: ground_truth/joint_states: position[trunk]: "
        "0.523599 rad in A, 0.6 rad in B, 0.0764012 rad apart"
    )
    assert not diff(first, planned(tmp_path / "c.mcap", controller="lqr")).same_plan


@pytest.mark.parametrize(
    ("topic", "field", "unit"),
    [
        ("joint_states", "position[pelvis]", " m"),
        ("joint_states", "velocity[trunk]", " rad/s"),
        ("disturbance", "effort[pelvis]", " N"),
        ("effort_command", "effort[trunk]", " N m"),
        ("pid/state", "position[kd]", " N m s/rad"),
        ("pid/state", "position[alpha]", ""),
        ("pid/state", "position[i_term]", " N m"),
        ("fuzzy/state", "position[table_term]", " N m"),
        ("lqr/state", "position[reference]", " rad"),
        ("own/state", "position[adapted]", ""),
    ],
)
def test_differences_of_other_plans_have_their_unit(topic, field, unit):
    told = FirstDifference(5_000_000, topic, field, 1.0, 3.5).describe(False, hip="pelvis")
    assert told == f"t = 0.005 s: {topic}: {field}: 1{unit} in A, 3.5{unit} in B, 2.5{unit} apart"


@pytest.mark.parametrize(
    ("topic", "field", "unit"),
    [
        ("ground_truth/joint_states", "position[cart]", " m"),
        ("ground_truth/joint_states", "effort[pole]", " N"),
        ("effort_command", "effort[pole]", " N"),
        ("disturbance", "effort[cart]", " N"),
        ("disturbance", "effort[pole]", " N m"),
        ("pid/state", "position[kd]", " N s/rad"),
        ("pid/state", "position[error]", " rad"),
    ],
)
def test_differences_of_another_plant_have_its_units(topic, field, unit):
    plant = PLANTS.named("cart_pole")
    told = FirstDifference(0, topic, field, 1.0, 3.5).describe(False, "cart", plant)
    assert told == f"t = 0 s: {topic}: {field}: 1{unit} in A, 3.5{unit} in B, 2.5{unit} apart"


def test_the_plant_is_that_of_the_runs(tmp_path):
    on_a_cart = ("simulator.plant.name=cart_pole",)
    runs = [
        planned(tmp_path / f"{limit}.mcap", *on_a_cart, f"pid.u_clamp_min=-{limit}")
        for limit in (3, 5)
    ]
    assert "effort[pole]: -3 N in A, -5 N in B, 2 N apart" in diff(*runs).describe()
