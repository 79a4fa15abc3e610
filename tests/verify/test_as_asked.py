"""What an operator did, against what was asked for: nobody, a hand too strong, one that holds too long."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from trunk_experiments.plans.operated import Operated
from trunk_experiments.replay.as_asked import not_as_asked
from trunk_msgs_util import topics
from trunk_sim.operator_input import NOTHING, Applied, OperatorLimits

H = 10  # ns, the period
LIMITS = OperatorLimits(hip_force=0.0, trunk_torque=50.0, timeout_ns=5 * H)
STRONG = Applied(0.0, 50.0)
HONEST = ((2 * H, Applied(0.0, 20.0)), (6 * H, STRONG), (9 * H, NOTHING))
ASKED = ((2, 20.0), (4, 20.0), (6, 99.0), (8, 99.0), (9, 0.0))


class Recorded:
    """A run of 100 states with an operator, as far as the check looks at it."""

    def __init__(self, changes=HONEST, asked=ASKED, limits=LIMITS, mode="real_time", branch=None):
        self.operated = Operated(changes)
        self.mode, self.branch, self._limits = mode, branch, limits
        efforts = np.array([[0.0, torque] for _, torque in asked]).reshape(-1, 2)
        requests = SimpleNamespace(
            stamp_ns=np.array([k * H for k, _ in asked], np.int64), values=lambda quantity: efforts
        )
        self._tables = {
            topics.OPERATOR_REQUEST: requests,
            topics.GROUND_TRUTH: SimpleNamespace(stamp_ns=np.arange(100) * H),
        }

    def config(self, node):
        return SimpleNamespace(operator_limits=self._limits, period_ns=H)

    def table(self, relative):
        return self._tables[relative]


def test_an_honest_hand():
    assert list(not_as_asked(Recorded())) == []
    assert list(not_as_asked(Recorded(changes=(), asked=()))) == []


@pytest.mark.parametrize(
    ("run", "said"),
    [
        (Recorded(limits=None), "3 messages, but operator.force and operator.torque are 0"),
        (Recorded(changes=((25, STRONG),)), "where there is no state"),
        (Recorded(changes=((2 * H, NOTHING),)), "nothing changes"),
        (Recorded(changes=(*HONEST[:1], (3 * H, HONEST[0][1]))), "nothing changes"),
        (Recorded(asked=()), "asked for by nobody"),
        (Recorded(asked=ASKED[1:]), "asked for by nobody"),  # not yet by then
        (Recorded(changes=((2 * H, Applied(0.0, 21.0)), *HONEST[1:])), "asked for by nobody"),
        (Recorded(changes=((6 * H, Applied(0.0, 99.0)), *HONEST[2:])), "asked for by nobody"),
        (Recorded(changes=HONEST[:2]), "longer than it was asked for"),
    ],
)
def test_another_hand(run, said):
    assert any(said in line for line in not_as_asked(run)), list(not_as_asked(run))


def test_who_repeats_a_run_asks_for_nothing():
    assert list(not_as_asked(Recorded(asked=(), mode="offline"))) == []
    branch = SimpleNamespace(at=5 * H * 1e-9)
    assert list(not_as_asked(Recorded(asked=ASKED[:2], branch=branch))) == []
