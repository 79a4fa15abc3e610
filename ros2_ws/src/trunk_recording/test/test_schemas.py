import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core import topics
from trunk_recording import schemas

texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)
integers = st.integers(-(2**63), 2**63 - 1)
floats = st.floats(allow_nan=False)
values = st.one_of(
    st.booleans(),
    integers,
    floats,
    texts,
    *(st.lists(e, min_size=1, max_size=4).map(tuple) for e in (integers, floats, texts)),
)
sets = st.dictionaries(texts, values, max_size=4)
stamps = st.integers(0, 2**31 * 10**9 - 1)


@given(stamps, texts, sets, sets, texts)
def test_parameters_round_trip_with_their_types(stamp_ns, node, new, changed, source):
    data = schemas.parameter_event(stamp_ns, node, new, changed, source=source)
    read = schemas.parse_parameter_event(data)
    assert read == (stamp_ns, node, new, changed, source)
    for name, value in new.items():  # True == 1 == 1.0
        assert type(read.new[name]) is type(value)
        if isinstance(value, tuple):
            assert [type(v) for v in read.new[name]] == [type(v) for v in value]


def test_an_empty_array_takes_the_given_kind():
    message = pytest.importorskip("rcl_interfaces.msg")
    serialization = pytest.importorskip("rclpy.serialization")
    kinds = {"a": "double array", "b": "string array", "c": "integer array"}
    data = schemas.parameter_event(0, "/n", dict.fromkeys(kinds, ()), {}, kinds)
    read = serialization.deserialize_message(data, message.ParameterEvent)
    assert [p.value.type for p in read.new_parameters] == [8, 9, 7]
    assert schemas.parse_parameter_event(data).new == dict.fromkeys(kinds, ())


def test_an_empty_array_of_unknown_kind_is_refused_by_name():
    with pytest.raises(ValueError, match=r"'pulse\.start_times'"):
        schemas.parameter_event(0, "/n", {"pulse.start_times": ()}, {})


def test_rclpy_reads_the_parameters():
    parameter = pytest.importorskip("rclpy.parameter")
    message = pytest.importorskip("rcl_interfaces.msg")
    serialization = pytest.importorskip("rclpy.serialization")
    new = {"b": True, "i": -3, "d": 0.1, "s": "ü", "dd": (1.0, 2.0), "ss": ("x", "y"), "ii": (1,)}
    data = schemas.parameter_event(1_500_000_000, "/robot/pid", new, {})
    read = serialization.deserialize_message(data, message.ParameterEvent)
    assert (read.stamp.sec, read.stamp.nanosec, read.node) == (1, 500_000_000, "/robot/pid")
    seen = {p.name: parameter.Parameter.from_parameter_msg(p).value for p in read.new_parameters}
    assert {n: tuple(v) if n in ("dd", "ss", "ii") else v for n, v in seen.items()} == new


@given(stamps, texts, texts, st.dictionaries(texts, texts, max_size=4), st.integers(0, 3), texts)
def test_events_round_trip(stamp_ns, node, message, pairs, level, source):
    data = schemas.event(stamp_ns, node, message, pairs, level, source)
    assert schemas.parse_event(data) == (stamp_ns, node, message, pairs, level, source)


def test_an_event_is_the_message_that_rclpy_reads():
    serialization = pytest.importorskip("rclpy.serialization")
    message = pytest.importorskip("diagnostic_msgs.msg")
    data = schemas.event(7, "/sim", "finished", {"states": 11}, topics.LEVEL_ERROR, "sim@boot.1.2")
    sent = message.DiagnosticArray()
    sent.header.stamp.nanosec, sent.header.frame_id = 7, "sim@boot.1.2"
    values = [message.KeyValue(key="states", value="11")]
    words = {"name": "/sim", "message": "finished", "hardware_id": "trunk", "values": values}
    sent.status = [message.DiagnosticStatus(level=message.DiagnosticStatus.ERROR, **words)]
    assert serialization.deserialize_message(data, message.DiagnosticArray) == sent


@pytest.mark.parametrize("parse", [schemas.parse_event, schemas.parse_parameter_event])
@given(st.binary(max_size=60))
def test_malformed_bytes_raise_value_error(parse, data):
    with pytest.raises(ValueError, match=r"\w"):
        parse(b"\x00\x01\x00\x00\xff" + data)


def test_definitions_are_those_of_ros_2():
    text = schemas.definition(topics.JOINT_STATE_TYPE).decode()
    assert "builtin_interfaces/Time stamp" in text
    assert "MSG: std_msgs/Header" in text
    with pytest.raises(ValueError, match="no message type"):
        schemas.definition("trunk/msg/None")
