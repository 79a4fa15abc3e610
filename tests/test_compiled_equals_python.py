"""The scalar functions, compiled by numba from the same sources, give the bits of CPython."""

from __future__ import annotations

from itertools import product
from math import pi

import numpy as np
import pytest

from trunk_control import computed_torque, fuzzy, fuzzy_pid, lqr, pid, pid_family, reference
from trunk_control.controller_config import ANTIWINDUP_STRATEGIES, DERIVATIVE_MODES
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.law import Hip, Sample
from trunk_control.limits import Limits
from trunk_control.pid_family import Gains, PidState, rescaled
from trunk_msgs_util import mechanics, units
from trunk_msgs_util.compiled import compiled
from trunk_msgs_util.mechanics import Body
from trunk_sim import disturbances, plant

MODULES = (
    mechanics,
    plant,
    disturbances,
    pid,
    pid_family,
    fuzzy,
    fuzzy_pid,
    lqr,
    computed_torque,
    reference,
    units,
)


class Twins:
    """The compiled twin of every function of the modules, by name. Each compiles at its first call."""

    def __init__(self) -> None:
        self._made = {}

    def __getitem__(self, name: str):
        if name not in self._made:
            found = [vars(module)[name] for module in MODULES if name in vars(module)]
            self._made[name] = compiled(found[0])
        return self._made[name]


@pytest.fixture(scope="module")
def twin():
    return Twins()


def bits(value) -> list[str]:
    if isinstance(value, tuple):
        return [text for item in value for text in bits(item)]
    return [float(value).hex()]


def arrays(record):
    """Return a named tuple with its tuples as arrays, as a compiled batch holds them."""
    return record._make(np.array(v) if isinstance(v, tuple) else v for v in record)


def plants(count: int, seed: int):
    rng = np.random.default_rng(seed)
    for k in range(count):
        parameters = Body(*rng.uniform(0.1, 5.0, 6).tolist(), bool(k % 2), k % 5 == 0)
        state = plant.PlantState(*rng.uniform(-4.0, 4.0, 4).tolist())
        yield state, *rng.normal(0.0, 30.0, 2).tolist(), parameters


def on_harmonics(count: int, seed: int):
    """Yield plants on a path of 1 to 32 harmonics: CPython's arguments, and the array of compiled code."""
    rng = np.random.default_rng(seed)
    for k, (*arguments, p) in enumerate(plants(count, seed)):
        numbers = rng.uniform(-0.3, 0.3, 2 * (1 + k % 32))
        plain = p._replace(as_printed=False, harmonics=tuple(numbers.tolist()))
        yield (*arguments, plain), (*arguments, plain._replace(harmonics=numbers))


def test_accelerations_on_harmonics(twin):
    for expected, given in on_harmonics(2000, seed=21):
        assert bits(twin["accelerations"](*given)) == bits(plant.accelerations(*expected))


def test_energy_on_harmonics(twin):
    for (state, *_, expected), (*_, given) in on_harmonics(1000, seed=22):
        assert bits(twin["energy"](state, given)) == bits(plant.energy(state, expected))


def test_rk4_step_on_harmonics(twin):
    for (*first, expected), (*_, given) in on_harmonics(1000, seed=23):
        found = twin["rk4_step"](*first, 0.005, given)
        assert bits(found) == bits(plant.rk4_step(*first, 0.005, expected))


def test_inverse_dynamics_on_harmonics(twin):
    for (state, *_, expected), (*_, given) in on_harmonics(1000, seed=24):
        found = twin["inverse_dynamics"](*state, given)
        assert bits(found) == bits(mechanics.inverse_dynamics(*state, expected))


def test_accelerations(twin):
    for arguments in plants(4000, seed=1):
        assert bits(twin["accelerations"](*arguments)) == bits(plant.accelerations(*arguments))


def test_energy(twin):
    for state, _, _, p in plants(2000, seed=2):
        assert bits(twin["energy"](state, p)) == bits(plant.energy(state, p))


@pytest.mark.slow
def test_rk4_step(twin):
    for state, force, torque, p in plants(3000, seed=3):
        arguments = (state, force, torque, 0.005, p)
        assert bits(twin["rk4_step"](*arguments)) == bits(plant.rk4_step(*arguments))


@pytest.mark.slow
def test_advance(twin):
    for k, (state, force, torque, p) in enumerate(plants(2000, seed=4)):
        arguments = (state, force, torque, 0.001, 1 + k % 10, p)
        assert bits(twin["advance"](*arguments)) == bits(plant.advance(*arguments))


def pid_inputs(count: int, seed: int, law: Limits):
    rng = np.random.default_rng(seed)
    for k in range(count):
        numbers = rng.normal(0.0, 1.0, 8).tolist()
        state = PidState(*numbers[:5], k % 5 > 0)
        sample = numbers[5:]
        if k % 7 == 0:
            sample[k % 3] = float("nan")
        dt = 0.0 if k % 11 == 0 else float(rng.uniform(1e-4, 0.1))
        gains = Gains(*(rng.uniform(0.0, 100.0, 3) * (rng.random(3) < 0.8)).tolist())
        yield state, *sample, dt, gains, law


LAWS = [
    Limits(derivative, filter_time, -20.0, 20.0, -8.0, 9.0, antiwindup, tracking)
    for derivative, antiwindup, (filter_time, tracking) in product(
        range(3), range(3), ((0.0, 0.0), (0.02, 0.3))
    )
] + [Limits()]


def law_id(law: Limits) -> str:
    filtered = "filtered" if law.filter_time else "unfiltered"
    limits = "limited" if law.u_max < 1e9 else "free"
    names = DERIVATIVE_MODES[law.derivative], ANTIWINDUP_STRATEGIES[law.antiwindup]
    return "-".join([*names, filtered, limits])


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=law_id)
def test_pid_update(twin, law):
    for arguments in pid_inputs(400, 5, law):
        assert bits(twin["pid_update"](*arguments)) == bits(pid.pid_update(*arguments))


def test_pid_update_with_a_negative_dt(twin):
    state = PidState(0.1, 0.2, -0.2, 0.3, 4.0, True)
    arguments = (state, 0.0, 0.0, 0.0, -1e-3, Gains(1.0, 1.0, 1.0), Limits())
    assert bits(twin["pid_update"](*arguments)) == bits(pid.pid_update(*arguments))


def test_retune(twin):
    for state, *_, gains, _ in pid_inputs(1000, 6, Limits()):
        new = Gains(gains.d, gains.p, gains.i)
        assert bits(twin["rescaled"](state, gains, new)) == bits(rescaled(state, gains, new))


@pytest.fixture(params=["linear", "log"])
def rules(request) -> fuzzy.FuzzyRules:
    return FuzzyPidConfig(consequents=request.param).rules


@pytest.mark.slow
def test_infer(twin, rules):
    rng = np.random.default_rng(7)
    inputs = rng.uniform((-2.0, -6.0), (2.0, 6.0), (4000, 2)).tolist()
    inputs += [(e, rate) for e in rules.error_peaks for rate in rules.rate_peaks]
    compiled_rules = arrays(rules)
    for e, rate in inputs:
        assert bits(twin["infer"](e, rate, compiled_rules)) == bits(fuzzy.infer(e, rate, rules))


@pytest.mark.slow
def test_fuzzy_pid_update(twin, rules):
    box, compiled_rules = fuzzy_pid.GainBox(), arrays(rules)
    for state, *inputs, _, limits in pid_inputs(2000, 8, LAWS[-2]):
        sample = Sample(*inputs)
        expected = fuzzy_pid.fuzzy_pid_update(state, sample, (rules, box), limits)
        actual = twin["fuzzy_pid_update"](state, sample, (compiled_rules, box), limits)
        assert bits(actual) == bits(expected)


def test_lqr_update(twin):
    for state, *inputs, gains, limits in pid_inputs(2000, 10, LAWS[-2]):
        arguments = (state, Sample(*inputs), (gains, 4.905), limits)
        assert bits(twin["lqr_update"](*arguments)) == bits(lqr.lqr_update(*arguments))


@pytest.mark.slow
def test_updates_at_extreme_numbers(twin, rules):
    """Where products overflow, both hold the same command."""
    rng = np.random.default_rng(13)
    box, compiled_rules = fuzzy_pid.GainBox(), arrays(rules)
    held = 0
    for k in range(4000):
        size = 10.0 ** rng.uniform(-330.0, 308.0, 12)
        numbers = (size * rng.choice([-1.0, 1.0], 12)).tolist()
        state = PidState(*numbers[:5], k % 5 > 0)
        sample = (*numbers[5:8], float(10.0 ** rng.uniform(-9.0, 9.0)))
        law = LAWS[k % len(LAWS)]
        gains = Gains(*np.abs(numbers[8:11]).tolist())
        expected = pid.pid_update(state, *sample, gains, law)
        held += expected[0] is state
        assert bits(twin["pid_update"](state, *sample, gains, law)) == bits(expected)
        expected = fuzzy_pid.fuzzy_pid_update(state, Sample(*sample), (rules, box), law)
        actual = twin["fuzzy_pid_update"](state, Sample(*sample), (compiled_rules, box), law)
        assert bits(actual) == bits(expected)
        other = Gains(gains.d, gains.p, gains.i)
        assert bits(twin["rescaled"](state, gains, other)) == bits(rescaled(state, gains, other))
    assert held > 100


def test_computed_torque_update(twin):
    rng = np.random.default_rng(11)
    for k, (state, *inputs, gains, limits) in enumerate(pid_inputs(2000, 12, LAWS[-2])):
        sample = Sample(*inputs, Hip(*rng.normal(0.0, 2.0, 2).tolist()))
        model = Body(*rng.uniform(0.1, 5.0, 6).tolist(), bool(k % 2))
        arguments = (state, sample, (gains, model), limits)
        expected = computed_torque.computed_torque_update(*arguments)
        assert bits(twin["computed_torque_update"](*arguments)) == bits(expected)


STAMPS = [0, 1, 2**53, *np.random.default_rng(9).integers(0, 10**11, 1000).tolist()]


def test_pulse(twin):
    starts = (0, 10**9, 50 * 10**9)
    for t_ns in STAMPS:
        expected = disturbances.pulse(t_ns, starts, 20 * 10**9, 1.5)
        assert bits(twin["pulse"](t_ns, np.array(starts), 20 * 10**9, 1.5)) == bits(expected)


def test_multisine(twin):
    amplitude, *components = disturbances.noise_components(2.0, 0.5, 5.0, 32, seed=1)
    compiled_components = [np.array(values) for values in components]
    for t in (t_ns / 1e9 for t_ns in STAMPS):
        expected = disturbances.multisine(t, amplitude, *components)
        assert bits(twin["multisine"](t, amplitude, *compiled_components)) == bits(expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["held", "interpolated"])
def test_time_table(twin, name):
    rng = np.random.default_rng(8)
    for count in (0, 1, 2, 7):
        times = tuple(sorted(rng.integers(0, 60 * 10**9, count).tolist()))
        times += times[-1:] if count > 2 else ()  # a jump
        values = tuple(rng.uniform(-3.0, 3.0, len(times)).tolist())
        rows = (np.array(times, dtype=np.int64), np.array(values, dtype=np.float64))
        for t_ns in (*STAMPS, *times):
            expected = vars(units)[name](t_ns, times, values, -0.25)
            assert bits(twin[name](t_ns, *rows, -0.25)) == bits(expected)


@pytest.mark.slow
@pytest.mark.parametrize("linear", [True, False], ids=["linear", "hold"])
@pytest.mark.parametrize("channels", [(0, 1, 2, 3), (3, 3, 3, 3), (1, 0, 3, 1)], ids=str)
def test_disturbance_at(twin, channels, linear):
    pulses, sine, noise, table = channels
    components = disturbances.noise_components(2.0, 0.5, 5.0, 32, seed=2)
    signals = disturbances.Signals(
        pulses, (10**9, 5 * 10**9), 3 * 10**10, 1.7, sine, 2.5, 0.7, 0.3, noise, *components,
        table, linear, (2 * 10**9, 3 * 10**10, 4 * 10**10), (0.3, -0.7, 1.1),
    )  # fmt: skip
    compiled_signals = arrays(signals)
    for t_ns in STAMPS:
        expected = disturbances.disturbance_at(t_ns, signals)
        assert bits(twin["disturbance_at"](t_ns, compiled_signals)) == bits(expected)


@pytest.mark.parametrize("kind", range(5), ids=reference.PROFILES)
def test_reference_at(twin, kind):
    profile = reference.ReferenceProfile(
        kind, pi / 4.0, 0.1, 2 * 10**9, 0.3, 0.7, (10**9, 10**10, 5 * 10**10), (0.2, -0.1, 0.5)
    )
    compiled_profile = arrays(profile)
    for t_ns in STAMPS:
        expected = reference.reference_at(t_ns, profile)
        assert bits(twin["reference_at"](t_ns, compiled_profile)) == bits(expected)
