"""The pictures of a recorder: of the plant as it is when they are drawn."""

import pytest

pytest.importorskip("rclpy")

from trunk_core import topics
from trunk_core.parameters.declarations import values_of
from trunk_core.samples import JointSample
from trunk_msgs_util.node.conversions import sample_to_wire
from trunk_msgs_util.node.recorder_node import Pictures
from trunk_recording.schemas import ParameterChange, deserialize
from trunk_sim.config import TrunkSimulator


def hip_of(pictures, stamp_ns):
    truth = JointSample(stamp_ns, ("hip", "trunk"), (0.5, 0.1), (0.0, 0.0), (0.0, 0.0))
    messages = dict(pictures.picture(stamp_ns, sample_to_wire(truth), stamp_ns))
    (hip,) = (
        marker
        for marker in deserialize(topics.MARKER_ARRAY_TYPE, messages["markers"]).markers
        if marker.ns == "hip"
    )
    return hip.pose.position.z


def test_a_path_that_changes_alone_is_drawn():
    pictures = Pictures()
    known = dict(values_of(TrunkSimulator()))
    pictures.reconfigure(ParameterChange(0, "/run/plant", known, {}))
    before = hip_of(pictures, 0)
    pictures.reconfigure(ParameterChange(1, "/run/pid", {"path.amplitude": 5.0}, {}))
    assert hip_of(pictures, 50_000_000) == before, "another node's parameter"
    pictures.reconfigure(ParameterChange(2, "/run/plant", {}, {"path.amplitude": 2.0}))
    assert hip_of(pictures, 100_000_000) == 2.0 * before != 0.0
    unknown = {**known, "plant.name": "furuta"}
    assert "'furuta'" in pictures.reconfigure(ParameterChange(3, "/run/plant", unknown, {}))


def test_a_state_that_comes_before_the_plants_parameters_costs_no_picture():
    pictures = Pictures()
    truth = JointSample(0, ("hip", "trunk"), (0.5, 0.1), (0.0, 0.0), (0.0, 0.0))
    assert not [*pictures.picture(0, sample_to_wire(truth), 0)]
    known = dict(values_of(TrunkSimulator()))
    pictures.reconfigure(ParameterChange(0, "/run/plant", known, {}))
    assert hip_of(pictures, 5_000_000)
