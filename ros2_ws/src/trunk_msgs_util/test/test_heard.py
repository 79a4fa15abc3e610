"""What publishers sent and nobody received, by the sequence numbers of the messages that were received."""

from __future__ import annotations

import pytest

from trunk_msgs_util.node.heard import Sources


def told(numbers, publishers=1, under_way=True):
    sources = Sources()
    for number in numbers:
        sources.of(number, publishers, under_way)
    return [(source.missed, source.lost) for source in sources.all]


@pytest.mark.parametrize(
    ("numbers", "publishers", "found"),
    [
        ([1, 2, 3], 1, [(0, 0)]),
        ([5, 6, 7], 1, [(4, 0)]),
        ([1, 2, 5], 1, [(0, 2)]),
        ([1, 1, 2, 2], 2, [(0, 0), (0, 0)]),
        ([1, 2, 3, 1, 2, 4, 3], 2, [(0, 0), (0, 0)]),
        ([1, 2, 9, 3, 10], 2, [(0, 0), (8, 0)]),
        ([1, 2, 1, 4], 2, [(0, 1), (0, 0)]),
    ],
)
def test_what_was_missed_and_lost(numbers, publishers, found):
    assert told(numbers, publishers) == found


def test_what_came_before_the_run_is_not_missed():
    assert told([1_000_000, 1_000_001], under_way=False) == [(0, 0)]
