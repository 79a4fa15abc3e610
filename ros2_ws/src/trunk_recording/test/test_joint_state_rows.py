"""Messages packed in bulk are those packed one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.samples import JointSample
from trunk_core.units import LAST_STAMP_NS
from trunk_recording.cdr import JointStateLayout

NAMES = st.lists(st.text("ab\u00e4", max_size=9), max_size=4, unique=True).map(tuple)
STAMPS = st.lists(st.integers(-1 - LAST_STAMP_NS, LAST_STAMP_NS), min_size=1, max_size=4)


@given(names=NAMES, stamps=STAMPS, has=st.tuples(*[st.booleans()] * 3), seed=st.integers(0, 99))
def test_the_bytes_are_those_of_single_messages(names, stamps, has, seed):
    counts = [len(names) * one for one in has]
    layout = JointStateLayout(names, *counts)
    bits = np.random.default_rng(seed).bytes(8 * len(stamps) * sum(counts))
    values = np.frombuffer(bits).reshape(len(stamps), -1)
    values = np.where(np.isnan(values), 0.5, values)  # of NaN some bits are free
    parts = np.split(values, np.cumsum(counts)[:-1], axis=1)
    found = layout.pack_rows(
        np.array(stamps), position=parts[0], velocity=parts[1], effort=parts[2]
    )
    assert [one.tobytes() for one in found] == [
        layout.pack(JointSample(stamp, names, *(tuple(part[row].tolist()) for part in parts)))
        for row, stamp in enumerate(stamps)
    ]


def test_what_does_not_fit_is_refused():
    layout = JointStateLayout(("trunk",), 1)
    with pytest.raises(ValueError, match=r"position of shape \(1, 2\): 1 values per message"):
        layout.pack_rows(np.array([0]), position=np.zeros((1, 2)))
    with pytest.raises(ValueError, match="stamps beyond"):
        layout.pack_rows(np.array([LAST_STAMP_NS + 1]), position=np.zeros((1, 1)))
