"""The core against public libraries, side by side in one run: fuzzy inference and the PID update.

Times depend on the machine, so we compare ratios of times that are taken alternately in one process.
The libraries are optional (pyfuzzylite is GPL-3.0); each must first give our results.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from random import Random
from time import perf_counter
from typing import Any

from trunk_control.fuzzy import infer
from trunk_control.fuzzy_pid import FuzzyPidConfig, fuzzy_pid_update
from trunk_control.law import DERIVATIVE_ON_MEASUREMENT, Limits, Sample
from trunk_control.pid import pid_update
from trunk_control.pid_family import Gains, PidState
from trunk_control.rule_tables import MOST
from trunk_control.rulebase.exporting import written

from .harness import BenchError, Row, library

FUZZY_GOAL = 2000.0  # at least: pyfuzzylite's time over that of one inference
PID_GOAL = 2.0  # at most: the time of one update over simple-pid's
FUZZY_TOLERANCE = 1e-12
PID_TOLERANCE = 1e-9  # N m, after 200 updates

_DT = 0.005  # s
_LIMIT = 100.0  # N m
_GAINS = Gains(60.0, 100.0, 9.0)
# As in simple-pid: derivative on the measurement, integral term and command with the same limits.
_LIMITS = Limits(DERIVATIVE_ON_MEASUREMENT, 0.0, -_LIMIT, _LIMIT, -_LIMIT, _LIMIT)

Batch = Callable[[], int]  # makes some calls and returns how many


def compare(rounds: int = 7) -> list[Row]:
    """Compare one fuzzy evaluation with pyfuzzylite's, and one PID update with simple-pid's."""
    pyfuzzylite, simple_pid = "pyfuzzylite", "simple-pid"
    fuzzylite = library("fuzzylite", pyfuzzylite, "--no-deps -r requirements/fuzzy.txt")
    simple = library("simple_pid", simple_pid, "-r requirements/dev.txt")
    config = FuzzyPidConfig()
    large = large_rules()
    times = _measure(
        {
            "infer": _infer_batch(config),
            pyfuzzylite: _fuzzylite_batch(fuzzylite, config),
            "pid_update": _pid_batch(),
            simple_pid: _simple_pid_batch(simple),
            "fuzzy_pid_update": _fuzzy_pid_batch(config),
            "large": _infer_batch(large),
        },
        rounds,
    )

    return [
        Row.of(
            "fuzzy inference, 3 outputs: pyfuzzylite's time / ours",
            times["infer"], times[pyfuzzylite], "us", at_least=FUZZY_GOAL, inverse=True,
        ),
        Row.of(
            "PID update: our time / simple-pid's",
            times["pid_update"], times[simple_pid], "us", at_most=PID_GOAL,
        ),
        Row.of(
            "Fuzzy-PID update: our time / that of simple-pid's PID",
            times["fuzzy_pid_update"], times[simple_pid], "us",
        ),
        Row.of(
            "fuzzy inference, 64 x 64 rules (ours) / 7 x 7 (theirs), in CPython",
            times["large"], times["infer"], "us",
        ),
    ]  # fmt: skip


def large_rules() -> FuzzyPidConfig:
    """Return the largest rule base: 64 x 64 numbers, drawn with a fixed seed."""
    random, count = Random(4), MOST
    peaks = tuple(2.0 * i / (count - 1) - 1.0 for i in range(count))

    def table(low: float, high: float) -> tuple[str, ...]:
        return tuple(
            " ".join(f"{random.uniform(low, high):.3f}" for _ in range(count)) for _ in range(count)
        )

    return FuzzyPidConfig(
        error_peaks=peaks,
        rate_peaks=peaks,
        rules_kp=table(0.0, 1.0),
        rules_kd=table(0.0, 1.0),
        rules_alpha=table(2.0, 5.0),
    )


def _measure(batches: Mapping[str, Batch], rounds: int) -> dict[str, list[float]]:
    """Return each batch's seconds per call, round by round; the order rotates by one each round."""
    names = list(batches)
    times: dict[str, list[float]] = {name: [] for name in names}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for batch in batches.values():
            batch()  # warm up
        for _ in range(rounds):
            for name in names:
                start = perf_counter()
                calls = batches[name]()
                times[name].append((perf_counter() - start) / calls)
            names.append(names.pop(0))
    finally:
        if collecting:
            gc.enable()
    return times


def _inputs(config: FuzzyPidConfig, count: int, seed: int) -> list[tuple[float, float]]:
    """Return random (e, e_dot), about one in ten beyond the universe."""
    random = Random(seed)
    error, rate = 1.05 * config.error_range, 1.05 * config.rate_range
    return [(random.uniform(-error, error), random.uniform(-rate, rate)) for _ in range(count)]


def _infer_batch(config: FuzzyPidConfig) -> Batch:
    rules = config.rules
    inputs = _inputs(config, 20, seed=1)

    def batch() -> int:
        for _ in range(250):
            for error, rate in inputs:
                infer(error, rate, rules)
        return 250 * len(inputs)

    return batch


def _fuzzylite_batch(fuzzylite: Any, config: FuzzyPidConfig) -> Batch:
    """Return the batch of `_infer_batch` by pyfuzzylite, once it has given the same outputs."""
    engine = fuzzylite.FllImporter().from_string(written(config, ".fll"))
    error_input, rate_input = engine.input_variables

    def process(error: float, rate: float) -> None:
        error_input.value = error
        rate_input.value = rate
        engine.process()

    rules = config.rules
    for error, rate in _inputs(config, 100, seed=2):
        process(error, rate)
        theirs = [output.value for output in engine.output_variables]
        ours = infer(error, rate, rules)
        if not all(abs(a - b) <= FUZZY_TOLERANCE for a, b in zip(ours, theirs, strict=True)):
            raise BenchError(f"pyfuzzylite gives {theirs} at {(error, rate)}, infer gives {ours}")
    inputs = _inputs(config, 20, seed=1)

    def batch() -> int:
        for error, rate in inputs:
            process(error, rate)
        return len(inputs)

    return batch


def _measurements() -> list[float]:
    random = Random(3)
    return [random.uniform(-0.6, 0.6) for _ in range(200)]


def _pid_batch() -> Batch:
    measurements = _measurements()

    def batch() -> int:
        state = PidState()
        for _ in range(20):
            for measurement in measurements:
                state, _terms = pid_update(state, 0.0, measurement, 0.0, _DT, _GAINS, _LIMITS)
        return 20 * len(measurements)

    return batch


def _simple_pid_batch(simple_pid: Any) -> Batch:
    """Return the batch of `_pid_batch` by simple-pid, once it has given the same commands."""
    pid = simple_pid.PID(*_GAINS, setpoint=0.0, sample_time=None, output_limits=(-_LIMIT, _LIMIT))
    measurements = _measurements()
    state = PidState()
    for measurement in measurements:
        state, terms = pid_update(state, 0.0, measurement, 0.0, _DT, _GAINS, _LIMITS)
        theirs = pid(measurement, dt=_DT)
        if not abs(theirs - terms.effort) <= PID_TOLERANCE:
            raise BenchError(f"simple-pid gives {theirs!r}, pid_update gives {terms.effort!r}")

    def batch() -> int:
        pid.reset()
        for _ in range(20):
            for measurement in measurements:
                pid(measurement, dt=_DT)
        return 20 * len(measurements)

    return batch


def _fuzzy_pid_batch(config: FuzzyPidConfig) -> Batch:
    samples = [Sample(0.0, measurement, 0.0, _DT) for measurement in _measurements()]
    constants = config.constants

    def batch() -> int:
        state = PidState()
        for _ in range(20):
            for sample in samples:
                state, _terms = fuzzy_pid_update(state, sample, constants, _LIMITS)
        return 20 * len(samples)

    return batch
