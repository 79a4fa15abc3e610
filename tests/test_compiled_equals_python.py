"""The scalar functions, compiled by numba from the same sources, give the bits of CPython."""

from collections.abc import Callable, Iterator
from itertools import product
from math import nan, pi
from typing import Any

import numpy as np
import pytest

from trunk_control import fuzzy
from trunk_control.computed_torque import computed_torque_update
from trunk_control.fuzzy_pid import FuzzyPidConfig, GainBox, fuzzy_pid_update
from trunk_control.law import Hip, Limits, Sample
from trunk_control.lqr import lqr_update
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState, rescaled
from trunk_control.reference import PROFILES, ReferenceProfile, reference_at
from trunk_control.state_feedback import state_feedback_update
from trunk_core.compiled import compiled, with_arrays
from trunk_core.mechanics import Body, inverse_dynamics
from trunk_core.units import held, interpolated
from trunk_sim import plant
from trunk_sim.disturbances import Signals, disturbance_at, multisine, noise_components, pulse
from trunk_sim.plant import advance, rk4_step
from trunk_sim.plants import trunk
from trunk_sim.plants.trunk import passive, prescribed

Arguments = Iterator[tuple[Any, ...]]

LIMITS = [
    Limits(derivative, filter_time, -20.0, 20.0, -8.0, 9.0, antiwindup, tracking)
    for derivative, antiwindup, (filter_time, tracking) in product(
        range(3), range(3), ((0.0, 0.0), (0.02, 0.3))
    )
] + [Limits()]
RULES = [FuzzyPidConfig(consequents=shape).rules for shape in ("linear", "log")]
STAMPS = [0, 1, 2**53, *np.random.default_rng(9).integers(0, 10**11, 1000).tolist()]


def bits(value: Any) -> list[str]:
    if isinstance(value, tuple):
        return [text for item in value for text in bits(item)]
    return [float(value).hex()]


def for_compiler(value: Any) -> Any:
    """Return an argument as a compiled batch holds it: numbers of any count in arrays."""
    if type(value) is not tuple:
        return with_arrays(value)
    if value and hasattr(value[0], "_fields"):
        return tuple(map(with_arrays, value))
    return np.array(value, dtype=type(value[0]) if value else float)


def plants(count: int) -> Arguments:
    """Yield a state, a force, a torque and a body: on a sine, then on 1 to 32 harmonics."""
    rng = np.random.default_rng(count)
    for k in range(2 * count):
        body = Body(*rng.uniform(0.1, 5.0, 6).tolist())
        if k >= count:
            numbers = rng.uniform(-0.3, 0.3, 2 * (1 + k % 32)).tolist()
            body = body._replace(harmonics=tuple(numbers))
        state = plant.PlantState(*rng.uniform(-4.0, 4.0, 4).tolist())
        yield state, *rng.normal(0.0, 30.0, 2).tolist(), body


def energies() -> Arguments:
    return ((state, body) for state, *_, body in plants(1500))


def torques() -> Arguments:
    return ((*state, body) for state, *_, body in plants(1000))


def steps() -> Arguments:
    return ((*loads, 0.005, body) for *loads, body in plants(2000))


def several_steps() -> Arguments:
    numbered = enumerate(plants(1000))
    return ((*loads, 0.001, 1 + k % 10, body) for k, (*loads, body) in numbered)


def one_step(
    state: plant.PlantState, force: float, torque: float, h: float, body: Body
) -> plant.PlantState:
    return rk4_step(state, force, torque, h, body, passive)


def one_period(
    state: plant.PlantState, force: float, torque: float, period: float, count: int, body: Body
) -> plant.PlantState:
    return advance(state, force, torque, period, count, body, prescribed)


def updates(count: int = 400 * len(LIMITS)) -> Arguments:
    """Yield a memory, a sample's numbers, gains and limits: usual ones, not usable ones, and extreme ones."""
    rng = np.random.default_rng(count)
    for k in range(count):
        numbers = rng.normal(0.0, 1.0, 8).tolist()
        dt = 0.0 if k % 11 == 0 else float(rng.uniform(1e-4, 0.1))
        gains = Gains(*(rng.uniform(0.0, 100.0, 3) * (rng.random(3) < 0.8)).tolist())
        if k % 7 == 0:
            numbers[5 + k % 3] = nan
        if k % 3 == 0:  # where products overflow, the command is held
            sizes = (10.0 ** rng.uniform(-330.0, 308.0, 11) * rng.choice([-1.0, 1.0], 11)).tolist()
            numbers, gains = sizes[:8], Gains(*map(abs, sizes[8:]))
            dt = float(10.0 ** rng.uniform(-9.0, 9.0))
        memory = PidState(*numbers[:5], k % 5 > 0)
        yield memory, *numbers[5:], dt, gains, LIMITS[k % len(LIMITS)]
    yield (
        PidState(0.1, 0.2, -0.2, 0.3, 4.0, True),
        0.0,
        0.0,
        0.0,
        -1e-3,
        Gains(1.0, 1.0, 1.0),
        Limits(),
    )


def retunings() -> Arguments:
    for memory, *_, gains, _ in updates():
        yield memory, gains, Gains(gains.d, gains.p, gains.i)


def fuzzy_updates() -> Arguments:
    for k, (memory, *sample, _, limits) in enumerate(updates()):
        yield memory, Sample(*sample), (RULES[k % 2], GainBox()), limits


def lqr_updates() -> Arguments:
    for memory, *sample, gains, limits in updates():
        yield memory, Sample(*sample), (gains, 4.905), limits


def feedback_updates() -> Arguments:
    rng = np.random.default_rng(13)
    for memory, *sample, gains, limits in updates():
        hip, own = Hip(*rng.normal(0.0, 2.0, 2).tolist()), rng.normal(0.0, 50.0, 2).tolist()
        yield memory, Sample(*sample, hip), (gains, *own), limits


def torque_updates() -> Arguments:
    rng = np.random.default_rng(11)
    for k, (memory, *sample, gains, limits) in enumerate(updates()):
        hip = Hip(*rng.normal(0.0, 2.0, 2).tolist())
        model = Body(*rng.uniform(0.1, 5.0, 6).tolist())
        yield memory, Sample(*sample, hip), (gains, model, bool(k % 2)), limits


def inferences() -> Arguments:
    rng = np.random.default_rng(7)
    for rules in RULES:
        for inputs in rng.uniform((-2.0, -6.0), (2.0, 6.0), (4000, 2)).tolist():
            yield *inputs, rules
        yield from product(rules.error_peaks, rules.rate_peaks, [rules])


def pulses() -> Arguments:
    return ((t_ns, (0, 10**9, 50 * 10**9), 20 * 10**9, 1.5) for t_ns in STAMPS)


def multisines() -> Arguments:
    components = noise_components(2.0, 0.5, 5.0, 32, seed=1)
    return ((t_ns / 1e9, *components) for t_ns in STAMPS)


def tables() -> Arguments:
    rng = np.random.default_rng(8)
    for count in (0, 1, 2, 7):
        times = tuple(sorted(rng.integers(0, 60 * 10**9, count).tolist()))
        times += times[-1:] if count > 2 else ()  # a jump
        values = tuple(rng.uniform(-3.0, 3.0, len(times)).tolist())
        for t_ns in (*STAMPS, *times):
            yield t_ns, times, values, -0.25


def disturbed() -> Arguments:
    components = noise_components(2.0, 0.5, 5.0, 32, seed=2)
    for (pulsed, sine, noise, table), linear in product(
        [(0, 1, 2, 3), (3, 3, 3, 3), (1, 0, 3, 1)], [True, False]
    ):
        signals = Signals(
            pulsed, (10**9, 5 * 10**9), 3 * 10**10, 1.7, sine, 2.5, 0.7, 0.3, noise, *components,
            table, linear, (2 * 10**9, 3 * 10**10, 4 * 10**10), (0.3, -0.7, 1.1),
        )  # fmt: skip
        for t_ns in STAMPS:
            yield t_ns, signals


def references() -> Arguments:
    for kind in range(len(PROFILES)):
        profile = ReferenceProfile(
            kind, pi / 4.0, 0.1, 2 * 10**9, 0.3, 0.7, (10**9, 10**10, 5 * 10**10), (0.2, -0.1, 0.5)
        )
        for t_ns in STAMPS:
            yield t_ns, profile


CASES: tuple[tuple[Callable[..., Any], Callable[[], Arguments]], ...] = (
    (trunk.passive, lambda: plants(3000)),
    (trunk.prescribed, lambda: plants(1000)),
    (trunk.as_printed, lambda: plants(1000)),
    (trunk.energy, energies),
    (one_step, steps),
    (one_period, several_steps),
    (inverse_dynamics, torques),
    (pid_update, updates),
    (rescaled, retunings),
    (fuzzy.infer, inferences),
    (fuzzy_pid_update, fuzzy_updates),
    (lqr_update, lqr_updates),
    (state_feedback_update, feedback_updates),
    (computed_torque_update, torque_updates),
    (pulse, pulses),
    (multisine, multisines),
    (held, tables),
    (interpolated, tables),
    (disturbance_at, disturbed),
    (reference_at, references),
)


@pytest.mark.slow
@pytest.mark.parametrize(("function", "inputs"), CASES, ids=[f.__name__ for f, _ in CASES])
def test_same_bits(function: Callable[..., Any], inputs: Callable[[], Arguments]) -> None:
    twin = compiled(function)
    for arguments in inputs():
        assert bits(twin(*map(for_compiler, arguments))) == bits(function(*arguments))


def test_the_inputs_reach_what_holds_the_command() -> None:
    assert sum(pid_update(*arguments)[0] is arguments[0] for arguments in updates()) > 100
