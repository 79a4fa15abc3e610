"""Sensor noise: the normal distribution out to its tails, by the seed and the step alone."""

import random

import mpmath
import numpy as np
import pytest
from scipy import stats

from trunk_core.compiled import twin
from trunk_sim import noise
from trunk_sim.noise import Noise, fill, noise_samples, random_bits, standard_normal

MOST = 2**53 - 1


def pairs(seed, steps):
    stream = Noise(seed)
    return [stream.pair(step) for step in steps]


def test_noise_is_a_function_of_its_seed_and_the_step():
    assert pairs(5, range(1500)) == pairs(5, range(1500))
    assert pairs(5, range(10)) != pairs(6, range(10))
    numbers = [700, 3, 10**12, 511, 512, 3]
    assert pairs(5, numbers) == [pairs(5, [step])[0] for step in numbers]


def test_many_at_once_are_those_of_each_step(monkeypatch):
    slowly = noise_samples(7, 1200)
    monkeypatch.setattr(noise, "_WORTH_COMPILING", 0)
    assert noise_samples(7, 1200).tolist() == slowly.tolist()
    assert pairs(7, range(1200)) == [tuple(row) for row in slowly.tolist()]


def test_noise_of_seed_1_stays_what_it_is():
    """NumPy guarantees the raw stream of PCG64; the rest is ours."""
    assert np.random.PCG64(1).random_raw(2).tolist() == [
        9441442522235856127,
        17532960557476522086,
    ]
    expected = ["-0x1.4fdfbdbe1db44p-1", "0x1.fcec7e59179aep-5"]
    assert [sample.hex() for sample in Noise(1).pair(0)] == expected


@pytest.mark.slow
def test_the_inverse_distribution_is_exact_to_a_few_units_in_the_last_place():
    rng = random.Random(1)
    cases = [rng.getrandbits(53) >> rng.randrange(0, 50) for _ in range(3000)]
    with mpmath.workdps(40):
        for bits in [0, 1, MOST - 1, MOST, *cases]:
            p = (mpmath.mpf(bits >> 1) + 0.5) / 2**53
            size = -mpmath.sqrt(2) * mpmath.erfinv(2 * p - 1)
            expected = size if bits & 1 else -size
            assert abs(standard_normal(bits) - expected) <= 8e-16 * size, bits


def test_the_distribution_rises_and_is_symmetric():
    rng = random.Random(2)
    upper = sorted((rng.getrandbits(52) >> rng.randrange(0, 40) for _ in range(5000)), reverse=True)
    values = [standard_normal(2 * m + 1) for m in upper]
    assert values == sorted(values)
    assert values == [-standard_normal(2 * m) for m in upper]


@pytest.fixture(scope="module")
def many():
    return noise_samples(1, 1_500_000)


@pytest.mark.slow
def test_kolmogorov_smirnov(many):
    for channel in many.T:
        assert stats.kstest(channel, "norm").pvalue > 0.01
    assert abs(np.corrcoef(many.T)[0, 1]) < 3e-3


@pytest.mark.parametrize("sigma", [1, 2, 3, 4, 4.5, 5])
def test_as_many_samples_are_in_the_tails_as_there_should_be(many, sigma):
    expected = many.size * stats.norm.sf(sigma)
    for count in (np.count_nonzero(many > sigma), np.count_nonzero(many < -sigma)):
        low, high = stats.poisson.interval(0.9999, expected)
        assert low <= count <= high


def test_compiled_code_returns_the_same_bits():
    bits = np.concatenate(
        [random_bits(3, 0, 20_000), [[0, 1], [MOST - 1, MOST], [2, 3], [1000, 1001]]]
    )
    slow, by_compiled_code = np.empty(bits.shape), np.empty(bits.shape)
    fill(bits.reshape(-1), slow.reshape(-1))
    twin(fill)(bits.reshape(-1), by_compiled_code.reshape(-1))
    assert slow.tobytes() == by_compiled_code.tobytes()
