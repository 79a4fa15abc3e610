"""What the events of a run say of changed parameters, in the page of a running graph."""

import json

import pytest

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_core.parameters.declarations import values_of
from trunk_views.live.feed import Board
from trunk_views.live.graph_state import Graph

S = 10**9


def retune(graph, stamp_ns, values, topics=(Graph.event, Graph.change)):
    """Change parameters of fuzzy_pid as its node does, on two topics between which there is no order."""
    for topic in topics:
        more = {Graph.event: ("retuned", {}), Graph.change: (values,)}[topic]
        topic(graph, "fuzzy_pid", stamp_ns, *more)


def listed(graph):
    graph.put_events()
    (said,) = (json.loads(t) for t in graph._board.texts() if json.loads(t)["kind"] == "events")
    return [(event["t"], event["changed"]) for event in said["events"]]


@pytest.fixture
def fuzzy():
    graph = Graph(Board())
    graph.parameters("fuzzy_pid", values_of(FuzzyPidConfig()))
    return graph


@pytest.mark.parametrize("first", [0, 1])
def test_an_event_says_what_was_changed_whichever_topic_is_ahead(fuzzy, first):
    topics = (Graph.event, Graph.change)[:: -1 if first else 1]
    rows = list(values_of(FuzzyPidConfig())["rules.kp"])
    retune(fuzzy, 2 * S, {"gains.p_max": 90.0}, topics)
    cells = rows[0].split()
    rows[0] = " ".join([cells[0], "MS", *cells[2:]])
    retune(fuzzy, 9 * S, {"rules.kp": rows, "gains.d_min": 8.5}, topics)
    axes = FuzzyPidConfig().axes
    cell = f"({axes.error[0]}, {axes.rate[1]}) {cells[1]} → MS"
    assert listed(fuzzy) == [
        (2.0, "gains.p_max 60 → 90"),
        (9.0, f"gains.d_min 9.6 → 8.5; rules.kp 1 cell: {cell}"),
    ]


def test_a_dragged_slider_is_one_event_and_two_changes_are_two(fuzzy):
    for stamp_ns, value in ((1, 61.0), (2, 70.0), (S, 90.0), (9 * S, 95.0)):
        retune(fuzzy, stamp_ns, {"gains.p_max": value})
    retune(fuzzy, 9 * S, {"gains.d_min": 8.5})
    fuzzy.event("pid", 9 * S, "reset", {})
    retune(fuzzy, 9 * S, {"gains.d_min": 8.0})
    assert listed(fuzzy) == [
        (1.0, "gains.p_max 60 → 90"),
        (9.0, "gains.p_max 90 → 95"),
        (9.0, "gains.d_min 9.6 → 8.5"),
        (9.0, ""),
        (9.0, "gains.d_min 8.5 → 8"),
    ]


def test_a_lost_message_does_not_give_an_event_the_change_of_another(fuzzy):
    retune(fuzzy, 1 * S, {"gains.p_max": 70.0}, (Graph.event,))
    retune(fuzzy, 5 * S, {"gains.p_max": 80.0}, (Graph.change,))
    retune(fuzzy, 9 * S, {"gains.p_max": 90.0})
    assert listed(fuzzy) == [(1.0, ""), (9.0, "gains.p_max 80 → 90")]
