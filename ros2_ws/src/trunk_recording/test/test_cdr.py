"""The bytes of rosbags, written without it; and whatever is read without it, rosbags reads the same."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core import topics
from trunk_recording import cdr, schemas

texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)
integers = st.integers(-(2**63), 2**63 - 1)
elements = {
    "bool": st.booleans(),
    "integer": integers,
    "double": st.floats(allow_nan=False),
    "string": texts,
}
kinds = {
    **elements,
    **{f"{k} array": st.lists(e, max_size=3).map(tuple) for k, e in elements.items()},
}
settings = st.dictionaries(
    texts, st.one_of(*(st.tuples(st.just(k), v) for k, v in kinds.items())), max_size=4
)


def event_of(told: dict[str, tuple[str, object]], source: str = "") -> bytes:
    values = {name: value for name, (_, value) in told.items()}
    kinds = {name: kind for name, (kind, _) in told.items()}
    return schemas.parameter_event(7, "/pid", values, {}, kinds, source)


def refuse(codec, data):
    raise ValueError("left to rosbags")


def rewritten(type_name: str, data: bytes) -> bytes:
    return schemas.serialize(type_name, schemas.deserialize(type_name, data))


def by_rosbags(monkeypatch: pytest.MonkeyPatch, parse, data: bytes) -> object:
    with monkeypatch.context() as without:
        without.setattr(cdr.Codec, "read", refuse)
        try:
            return repr(parse(data))  # repr: True == 1, 0.0 == -0.0
        except ValueError:
            return "refused"


@given(settings, texts)
def test_parameters_need_no_library(told, source):
    data = event_of(told, source)
    assert cdr.PARAMETER_EVENT.write(cdr.PARAMETER_EVENT.read(data)) == data
    assert rewritten(topics.PARAMETER_EVENT_TYPE, data) == data
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert repr(schemas.parse_parameter_event(data)) == by_rosbags(
            monkeypatch, schemas.parse_parameter_event, data
        )


@given(texts, texts, st.dictionaries(texts, texts, max_size=4), texts)
def test_events_need_no_library(node, message, pairs, source):
    data = schemas.event(7, node, message, pairs, source=source)
    assert cdr.DIAGNOSTIC_ARRAY.write(cdr.DIAGNOSTIC_ARRAY.read(data)) == data
    assert rewritten(topics.DIAGNOSTIC_ARRAY_TYPE, data) == data
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert repr(schemas.parse_event(data)) == by_rosbags(monkeypatch, schemas.parse_event, data)


@given(st.data())
def test_damaged_bytes_are_judged_alike(data):
    told = {"a": ("double array", (1.0,)), "b": ("string", "x"), "c": ("bool", True)}
    parse, whole = data.draw(
        st.sampled_from(
            [
                (schemas.parse_parameter_event, event_of(told, "pid@boot.1.2")),
                (schemas.parse_event, schemas.event(7, "/sim", "fell", {"angle": 1.6})),
                (schemas.parse_event, schemas.event(7, "/sim", "fell", source="sim@boot.1.2")),
            ]
        )
    )
    edited = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for _ in range(data.draw(st.integers(0, 3)) if edited else 0):
        edited[data.draw(st.integers(0, len(edited) - 1))] = data.draw(st.integers(0, 255))
    edited += data.draw(st.binary(max_size=5))
    try:
        found = repr(parse(bytes(edited)))
    except ValueError:
        found = "refused"
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert found == by_rosbags(monkeypatch, parse, bytes(edited))
