"""The pacing that a configuration asks for."""

from dataclasses import replace

import pytest

from trunk_sim.config import TrunkSimulator
from trunk_sim.pacing import make_pacing, tick_period

from .counting_loop import CountingLoop, H

EVERYBODY = ("effort_command", "disturbance", "recorder")


def test_real_time_uses_a_command_up_to_its_timeout():
    loop = CountingLoop()
    pacing = make_pacing(loop, TrunkSimulator(command_timeout=0.002))
    pacing.begin(0)
    pacing.command(0, 3.0, 0)
    for k in range(1, 5):
        pacing.tick(k * H)
    assert loop.efforts == [3.0, 3.0, 3.0, 0.0]


def test_lockstep_waits_for_the_configured_topics_with_their_windows():
    loop = CountingLoop()
    config = TrunkSimulator(
        update_rate=1000.0, lockstep=True, wait_for=EVERYBODY, lockstep_window=3
    )
    pacing = make_pacing(loop, config)
    pacing.begin(0)
    assert pacing.silent() == ["effort_command", "disturbance"]
    pacing.command(0, 0.0, 1)
    assert pacing.silent() == ["disturbance"]
    pacing.answered("disturbance", 9 * H, 1)
    pacing.command(H, 0.0, 1)
    assert pacing.silent() == ["effort_command"]
    pacing.command(2 * H, 0.0, 1)
    assert pacing.silent() == ["effort_command", "recorder"]  # at state 3 it wrote none yet
    alone = make_pacing(CountingLoop(), replace(config, wait_for=("effort_command",)))
    alone.begin(0)
    assert alone.silent() == ["effort_command"]


def test_lockstep_has_its_timeout_and_its_pace():
    loop = CountingLoop()
    config = TrunkSimulator(
        lockstep=True, wait_for=("effort_command",), lockstep_timeout=2.0, lockstep_speed=4.0
    )
    pacing = make_pacing(loop, config)
    pacing.begin(0)
    pacing.tick(2_000_000_000)
    assert loop.failure is None
    pacing.tick(2_000_000_001)
    assert "lockstep.timeout = 2 s" in loop.failure
    pacing.begin(0)
    pacing.command(0, 1.0, 1)
    assert loop.efforts == []
    pacing.tick(H // 4)
    assert loop.efforts == [1.0]


@pytest.mark.parametrize(
    ("mode", "period"),
    [
        ({}, 0.02),
        ({"lockstep": True}, 0.05),
        ({"lockstep": True, "lockstep_speed": 4.0}, 0.005),
        ({"lockstep": True, "lockstep_speed": 0.1}, 0.05),
    ],
    ids=["real time", "lock-step", "fast pace", "slow pace"],
)
def test_it_is_called_once_a_period_and_in_lockstep_at_least_every_50_ms(mode, period):
    waits = {"wait_for": ("effort_command",)} if mode else {}
    config = TrunkSimulator(update_rate=50.0, **mode, **waits)
    assert tick_period(config) == pytest.approx(period)
