"""Which publishers are known to send events: by their node's name, or by their process before it has one."""

from types import SimpleNamespace

import pytest

from trunk_core import topics
from trunk_msgs_util.node.discovery import reporting


def endpoint(name, process):
    space = topics.UNKNOWN_NODE if name == topics.UNKNOWN_NODE else "/"
    return SimpleNamespace(
        node_name=name, node_namespace=space, endpoint_gid=[process] * 12 + [0, 0, 0, 1]
    )


@pytest.mark.parametrize(
    ("giver", "reports", "found"),
    [
        (endpoint("pid", 1), [endpoint("pid", 1)], {"/pid"}),
        (endpoint("mine", 2), [endpoint("pid", 1)], set()),
        (endpoint("mine", 1), [endpoint("pid", 1)], set()),  # a stranger in the same process
        (endpoint("mine", 2), [], set()),
    ],
)
def test_a_publisher_with_a_name(giver, reports, found):
    node = SimpleNamespace(get_publishers_info_by_topic={topics.RUN_EVENTS: reports}.get)
    assert reporting(node, [giver]) == found


@pytest.mark.parametrize("process", [1, 2])
def test_a_publisher_without_a_name(process):
    reports = [endpoint(topics.UNKNOWN_NODE, 1)]
    node = SimpleNamespace(get_publishers_info_by_topic={topics.RUN_EVENTS: reports}.get)
    assert bool(reporting(node, [endpoint(topics.UNKNOWN_NODE, process)])) == (process == 1)
