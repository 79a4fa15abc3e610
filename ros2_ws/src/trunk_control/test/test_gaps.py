"""A gap in the states' stamps: nothing is integrated over it, at its edge and in compiled code."""

from dataclasses import replace
from math import inf

import pytest

from trunk_control.controller import Controller
from trunk_control.laws import REGISTERED, law_named
from trunk_control.pid import PidConfig
from trunk_core.units import NANOSECONDS

PERIOD_NS = NANOSECONDS // 200
LAWS = sorted(REGISTERED)


def driven(config, stamps_ns, law=None, angle=0.1):
    controller = Controller(config, law)
    return controller, [controller.update(stamp, angle, 0.0) for stamp in stamps_ns]


def test_a_jump_of_a_million_seconds_is_not_integrated():
    config = PidConfig(antiwindup_strategy="none")
    jump = 10**6 * NANOSECONDS
    stamps = [*range(0, 5 * PERIOD_NS, PERIOD_NS), *range(jump, jump + 3 * PERIOD_NS, PERIOD_NS)]
    controller, _ = driven(config, stamps)
    other_side = controller.update(jump + 3 * PERIOD_NS, -0.2, 0.0)
    assert other_side.effort > 0.0
    assert other_side.effort < config.u_clamp_max


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("periods", [3, 100])
@pytest.mark.parametrize("beyond", [0, 1])
def test_after_a_longer_gap_a_controller_starts_afresh(name, periods, beyond):
    law = law_named(name)
    config = replace(law.config(), max_gap_periods=periods)
    past = [0, PERIOD_NS]
    later = PERIOD_NS + periods * config.period_ns + beyond
    after, (*_, answer) = driven(config, [*past, later], law)
    fresh, (first,) = driven(config, [later], law)
    assert (answer.restarted, first.restarted) == (bool(beyond), False)
    if beyond:
        assert (after.state, answer._replace(restarted=False)) == (fresh.state, first)
    else:
        assert after.state.sample.dt == pytest.approx(periods / config.update_rate)


def test_without_a_limit_every_gap_is_a_step():
    _, answers = driven(
        PidConfig(max_gap_periods=0, u_clamp_max=inf, u_clamp_min=-inf), [0, 10**15]
    )
    assert answers[1].terms.i_term == pytest.approx(-PidConfig().i * 0.1 * (10**6 + 0.005))


def test_a_takeover_after_a_gap_starts_afresh():
    config = PidConfig()
    controller = Controller(config)
    controller.deactivate()
    controller.see(0, 0.1)
    controller.activate()
    assert controller.state.transfer.pending
    later = 101 * PERIOD_NS
    _, (first,) = driven(config, [later])
    assert controller.update(later, 0.1, 0.0) == first._replace(restarted=True)


def test_time_that_goes_back_is_a_new_run_and_is_told():
    stamps = [0, PERIOD_NS, 2 * PERIOD_NS, PERIOD_NS, 2 * PERIOD_NS]
    _, answers = driven(PidConfig(), stamps)
    assert [answer.restarted for answer in answers] == [False, False, False, True, False]
    assert answers[3] == answers[0]._replace(restarted=True)
