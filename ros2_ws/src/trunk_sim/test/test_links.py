"""Links pass on what a plain account of messages and arrivals says; their statistics are those declared."""

from math import exp, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.compiled import twin
from trunk_core.parameters.declarations import ParameterError, build
from trunk_sim.config import TrunkSimulator
from trunk_sim.links import (
    DRAWS,
    InFlight,
    Link,
    Network,
    Traffic,
    _draw,
    most_late,
    perfect,
    simulate_link,
    steps_late,
)

PERIOD = 5_000_000  # ns
STEPS = 20_000


def network(state=None, command=None, zero=False, dropout=0.0, seed=1):
    return Network(state or Link(), command or Link(), zero, dropout, seed, PERIOD)


def account(bits, link):
    """Return which message is in use in each step, and how many were overtaken: look at all arrivals."""
    arrivals = []
    burst = False
    for k, (turn, lost, _, again, lost_too, _) in enumerate((bits / 2.0**53).tolist()):
        burst ^= turn < (link.burst_end if burst else link.burst_begin)
        loss = link.burst_loss if burst else link.loss
        copies = [(lost, 2), (lost_too, 5)] if again < link.duplicates else [(lost, 2)]
        for share, column in copies:
            if not share < loss:
                arrivals.append((k + steps_late(int(bits[k, column]), link, PERIOD), k))
    used, in_use, overtaken = [], -1, 0
    for k in range(len(bits)):
        here = {sent for when, sent in arrivals if when == k}
        overtaken += len(here) - (bool(here) and max(here) >= in_use)
        if here and (max(here) > in_use or not link.latest):
            in_use = max(here)
        used.append(in_use)
    return used, overtaken


shares = st.floats(0.0, 1.0)
links = st.builds(
    Link,
    delay=st.floats(0.0, 0.03),
    jitter=st.floats(0.0, 0.03),
    exponential=st.booleans(),
    loss=shares,
    burst_begin=shares,
    burst_end=shares,
    burst_loss=shares,
    duplicates=shares,
    latest=st.booleans(),
)


@pytest.mark.slow
@given(links, st.integers(0, 2**31 - 1))
def test_the_message_in_use_is_that_of_a_plain_account(link, seed):
    traffic = Traffic(network(link, link, seed=seed))
    bits = _draw(seed, 1, 0, 120, DRAWS)
    steps, overtaken = account(bits, link)
    assert traffic.command_steps(120).tolist() == steps
    assert traffic.counts(120)["link.command"].endswith(f" {overtaken} overtaken")
    assert [Traffic(network(link, link, seed=seed)).command_step(k) for k in (0, 119)] == [
        traffic.command_step(0),
        traffic.command_step(119),
    ]
    seen = np.maximum(account(_draw(seed, 0, 0, 120, DRAWS), link)[0], 0)
    assert traffic.measurement_steps(120).tolist() == seen.tolist()


@pytest.mark.slow
@given(links, st.lists(st.integers(1, 900), max_size=4))
def test_drawing_it_in_parts_changes_nothing(link, steps):
    whole = Traffic(network(link, link, dropout=0.3)).measurement_steps(2000)
    parts = Traffic(network(link, link, dropout=0.3))
    for step in steps:
        parts.measurement_step(step)
    assert parts.measurement_steps(2000).tolist() == whole.tolist()


@pytest.mark.slow
@given(links)
def test_step_by_step_it_is_the_same_and_the_past_is_forgotten(link):
    noisy = network(link, link, zero=True, dropout=0.3)
    whole, stepwise = Traffic(noisy), Traffic(noisy, stepwise=True)
    commands, seen = (
        whole.command_steps(500),
        Traffic(noisy._replace(dropout=0.0)).measurement_steps(500),
    )
    for k in range(500):
        assert (stepwise.measurement_step(k), stepwise.command_step(k)) == (seen[k], commands[k])
        stepwise.dropped(k)
    assert stepwise.counts(500) == whole.counts(500)
    assert len(stepwise._state._rows) < 100


@pytest.mark.slow
@given(links)
def test_compiled_code_passes_on_the_same(link):
    bits = _draw(3, 0, 0, 300, DRAWS)

    def passed(function):
        memory, due = np.array([0, -1]), np.tile([-1, 0], (most_late(link, PERIOD) + 1, 1))
        used, outcome = np.empty(300, np.int64), np.empty((300, 3), np.int64)
        function(0, bits, link, PERIOD, memory, due, used, outcome)
        return used.tolist(), outcome.tolist(), memory.tolist()

    assert passed(twin(simulate_link)) == passed(simulate_link)


def within_three_sigma(count, share, of=STEPS):
    return abs(count - share * of) <= 3.0 * sqrt(of * share * (1.0 - share))


@pytest.mark.parametrize("seed", range(5))
def test_shares_are_those_declared(seed):
    link = Link(loss=0.1, duplicates=0.2)
    traffic = Traffic(network(link, link, dropout=0.05, seed=seed))
    counts = traffic.counts(STEPS)
    for link_name in ("state", "command"):
        sent, lost, late, doubled, overtaken = map(int, counts[f"link.{link_name}"].split()[::2])
        assert (sent, late, overtaken) == (STEPS, 0, 0)
        assert within_three_sigma(lost, 0.8 * 0.1 + 0.2 * 0.1**2)
        assert within_three_sigma(doubled, 0.2)
    assert within_three_sigma(int(counts["sensor.dropout"]), 0.05)


@pytest.mark.parametrize("seed", range(5))
def test_bursts_are_as_frequent_and_as_long_as_declared(seed):
    link = Link(burst_begin=0.02, burst_end=0.25)
    lost = np.diff(Traffic(network(command=link, seed=seed)).command_steps(STEPS), prepend=-1) == 0
    begins = np.flatnonzero(np.diff(lost.astype(int)) == 1)
    lengths = np.diff(np.flatnonzero(np.diff(lost.astype(int), prepend=0, append=0)))[::2]
    # Geometric with the mean 1/r; a burst begins in a share p r / (p + r) of the steps.
    assert abs(lengths.mean() - 4.0) <= 3.0 * sqrt(0.75) / 0.25 / sqrt(len(lengths))
    assert abs(len(begins) - 0.02 * 0.25 / 0.27 * STEPS) <= 3.0 * sqrt(len(begins))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("link", "mean", "sigma"),
    [
        (Link(delay=0.012), 12.0, 0.0),
        (Link(delay=0.01, jitter=0.03), 25.0, 30.0 / sqrt(12.0)),
        (Link(jitter=0.03, exponential=True), 30.0, 30.0),
    ],
)
def test_delays_are_those_declared(link, mean, sigma, seed):
    """In steps of a millisecond: each delay is rounded up to a whole number of them."""
    bits = _draw(seed, 0, 0, STEPS, DRAWS)[:, 2].tolist()
    steps = np.array([steps_late(number, link, 1_000_000) for number in bits])
    expected = mean + (0.5 if sigma else 0.0)
    assert abs(steps.mean() - expected) <= 3.0 * sigma / sqrt(STEPS) + 1e-9
    if link.exponential:
        assert within_three_sigma(int((steps > 30).sum()), exp(-1.0))


def test_links_seeds_and_ways_are_independent():
    def lost(link_name, seed):
        link = Link(loss=0.5)
        traffic = Traffic(network(link, link, seed=seed))
        used = (
            traffic.measurement_steps(STEPS)
            if link_name == "state"
            else traffic.command_steps(STEPS)
        )
        return used == np.arange(STEPS)

    losses = [lost("state", 1), lost("command", 1), lost("state", 2)]
    for i, series in enumerate(losses):
        for other in losses[:i]:
            assert within_three_sigma(int((series == other).sum()), 0.5)


def test_without_a_new_command_the_last_one_holds_or_none_acts():
    link = Link(loss=0.5)
    held = Traffic(network(command=link)).command_steps(200)
    zero = Traffic(network(command=link, zero=True)).command_steps(200)
    fresh = held == np.arange(200)
    assert (zero[fresh] == held[fresh]).all()
    assert (zero[~fresh] == -1).all()
    assert 50 < fresh.sum() < 150


@given(links, st.integers(0, 100))
def test_what_is_in_flight_is_what_was_sent(link, seed):
    traffic = Traffic(network(link, seed=seed))
    flight = InFlight(link, PERIOD)
    for k in range(200):
        used = traffic.measurement_step(k)
        assert flight.send(k, 10 * k, used) == 10 * used
    assert len(flight._sent) <= most_late(link, PERIOD) + 2


def test_a_link_that_changes_nothing_is_none():
    assert perfect(Link(duplicates=0.5, burst_begin=0.5, burst_loss=0.0, latest=False))
    assert build(TrunkSimulator, {"link.state.duplicates": 0.5, "link.seed": 7}).network is None
    config = build(TrunkSimulator, {"link.command.loss": 0.1, "link.command.missing": "zero"})
    assert config.network == Network(Link(), Link(loss=0.1), True, 0.0, 1, PERIOD)
    assert build(TrunkSimulator, {"sensor.dropout": 0.1}).network.dropout == 0.1


def test_what_would_need_too_much_memory_is_refused():
    values = {"link.state.jitter": 10.0, "link.state.jitter_kind": "exponential"}
    assert build(TrunkSimulator, {**values, "update_rate": 1000.0}).network is not None
    with pytest.raises(ParameterError, match=r"link\.state\.jitter.*at most 1000000 steps late"):
        build(TrunkSimulator, {**values, "update_rate": 1e6})
