"""Recordings of earlier versions, which lack what came later, verify as they did."""

from __future__ import annotations

import pytest

from trunk_experiments.plans.nodes import NODES
from trunk_experiments.replay.parameter_invariants import _LATER
from trunk_experiments.replay.verify import VERIFIED, verify
from trunk_msgs_util.parameters.declarations import declarations
from trunk_msgs_util.recording.schemas import parameter_event, parse_parameter_event

from ..edited import ANEW, copied
from .messages import of

NODES_OF_THE_RUN = ("simulator", "disturbance", "pid", "fuzzy_pid")
GROUPS = [(node, group) for node in NODES_OF_THE_RUN for group in _LATER[node]]
# How many parameters the first recordings of this format have; those added later belong in _LATER.
FIRST = {"simulator": 32, "disturbance": 17, "pid": 25, "fuzzy_pid": 35}


@pytest.mark.slow
@pytest.mark.one_in(3)
@pytest.mark.parametrize(("node", "group"), GROUPS, ids=[group[0] for _, group in GROUPS])
def test_parameters_that_came_later_may_be_missing(whole, tmp_path, node, group):
    kinds = {name: d.kind for name, d in declarations(NODES[node].config).items()}

    def leave_out(messages):
        for message in of(messages, "/run/parameters"):
            told = parse_parameter_event(message[2])
            if told.node == f"/{node}" and told.new:
                new = {name: value for name, value in told.new.items() if name not in group}
                message[2] = parameter_event(told.stamp_ns, told.node, new, {}, kinds)

    verdict = verify(copied(whole, tmp_path / "earlier.mcap", leave_out, ANEW))
    assert verdict.exit_code == VERIFIED, verdict.reasons


@pytest.mark.parametrize("node", FIRST)
def test_every_parameter_is_one_of_the_first_or_named_as_a_later_one(node):
    later = {name for group in _LATER[node] for name in group}
    assert len(set(declarations(NODES[node].config)) - later) == FIRST[node]
