"""All conversions between ROS messages and the project's own values."""

from __future__ import annotations

from array import array

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from trunk_core.samples import JointSample
from trunk_core.units import LAST_STAMP_NS, NANOSECONDS
from trunk_recording.cdr import JointStateLayout, layout_of, shared


def stamp_to_ros(stamp_ns: int) -> Time:
    """Return a stamp in ns as a Time message."""
    sec, nanosec = divmod(stamp_ns, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def stamp_from_ros(stamp: Time) -> int:
    """Return a Time message as ns."""
    nanoseconds: int = stamp.sec * NANOSECONDS + stamp.nanosec
    return nanoseconds


def sample_to_wire(sample: JointSample, frame_id: str = "") -> bytes:
    """Return the sample as a serialized JointState message, ready to publish.

    A quarter of the cost of a message object, and the same bytes.
    """
    return layout_of(sample, frame_id).pack(sample)


class WireReader:
    """Turns serialized JointState messages into samples, quickly where their layout stays the same.

    ``frame_id`` is that of the message read last: in real time the source of a message of our nodes.
    """

    def __init__(self) -> None:
        self._layout = JointStateLayout(())
        self._unusual_frame: str | None = None  # of a message that no layout describes

    @property
    def frame_id(self) -> str:
        return self._layout.frame_id if self._unusual_frame is None else self._unusual_frame

    def __call__(self, data: bytes) -> JointSample:
        """Return the sample; one without names and with stamp -1 ns if the bytes are not a valid message.

        A message whose nanoseconds push its stamp past the largest is not valid: no answer could carry it.
        Another byte order is left to rclpy.
        """
        sample = self._read(data)
        return sample if sample.stamp_ns <= LAST_STAMP_NS else JointSample(-1, ())

    def _read(self, data: bytes) -> JointSample:
        self._unusual_frame = None
        try:
            return self._layout.unpack(data)
        except ValueError:
            pass
        try:
            self._layout = shared(JointStateLayout.parse(data))
            return self._layout.unpack(data)
        except ValueError:
            pass
        try:
            message = deserialize_message(data, JointState)
            self._unusual_frame = message.header.frame_id
            return sample_from_ros(message)
        except Exception:  # anything that rclpy or the middleware may raise on a peer's bytes
            self._unusual_frame = ""
            return JointSample(-1, ())


def sample_to_ros(sample: JointSample) -> JointState:
    """Return the sample as a JointState message."""
    message = JointState()
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(sample.stamp_ns, NANOSECONDS)
    message.name = list(sample.name)
    message.position = array("d", sample.position)
    message.velocity = array("d", sample.velocity)
    message.effort = array("d", sample.effort)
    return message


def sample_from_ros(message: JointState) -> JointSample:
    """Return the JointState message as a sample."""
    return JointSample(
        stamp_from_ros(message.header.stamp),
        tuple(message.name),
        tuple(message.position),
        tuple(message.velocity),
        tuple(message.effort),
    )
