"""A kernel's runs have the bits of the CPU's, whatever the plan; a text is for all plans of a composition."""

import re
from collections import Counter, defaultdict
from dataclasses import replace
from functools import cache
from pathlib import Path
from struct import pack

import numpy as np
import pytest

from trunk_core.errors import PlanError
from trunk_runs.loop import check_compilable
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.plan import make_plan
from trunk_studies.batch import kernel as kernel_module
from trunk_studies.batch.block import summary_of
from trunk_studies.batch.kernel import (
    SOUND,
    UNSOUND,
    Kernel,
    fitted,
    kernel_of,
    start_of_run,
    words_of,
)
from trunk_studies.batch.varied import Varied

from ...trunk_runs.test.random_plans import DISTURBED, random_plan, several
from .cpp_device import COMPILER, FLAGS, CppDevice, kernel_and_words, summary_in

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler: apt-get install g++")
OUR_LAWS = ("pid", "fuzzy_pid", "lqr", "computed_torque", "fuzzy", "state_feedback")
FUSED = ("-ffp-contract=fast", "-mfma")


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    return CppDevice(tmp_path_factory.mktemp("kernels"))


def unfit(plan):
    """Return why a plan fits no kernel, empty if it does."""
    try:
        check_compilable(plan)
    except PlanError as error:
        return str(error)
    fit = fitted(plan)
    return fit if isinstance(fit, str) else ""


def bits(summary):
    """Return a run's outcome with its numbers' bits."""
    numbers = [] if summary.metrics is None else summary.metrics.as_dict().values()
    every = [summary.diverged_at, summary.fell, *numbers]
    return [None if number is None else pack("<d", number) for number in every]


def differences(plans, outcomes):
    """Return the scenarios whose run is not the CPU's, and how many there are of each fate."""
    wrong, fates = [], Counter()
    for i, plan in enumerate(plans):
        expected, computed = summary_of(plan), summary_in(outcomes, i)
        fates[int(outcomes.fates[i])] += 1
        if computed is None and expected.refused:
            continue
        if computed is None or bits(computed) != bits(expected):
            wrong.append((plan.scenario, expected, computed))
    return wrong, fates


def by_kernel(indices):
    """Return random plans that fit a kernel, by kernel."""
    plans = defaultdict(list)
    for plan in map(random_plan, indices):
        if not unfit(plan):
            plans[kernel_of(plan, start_of_run(plan))].append(plan)
    return plans


@pytest.fixture(scope="module")
def drawn():
    return by_kernel(range(200, 300))


@pytest.mark.slow
@pytest.mark.one_in(10)
@pytest.mark.parametrize("share", range(10))
def test_random_plans_give_the_bits_of_the_cpu(share, device):
    for plans in by_kernel(range(150 + share, 450, 10)).values():
        wrong, _ = differences(plans, device.run(*kernel_and_words(plans)))
        assert not wrong


def test_a_law_has_a_text_for_all_its_plans(drawn):
    """One for each plant's equations. The model of computed_torque has a path with harmonics or without."""
    first = (plans[0] for plans in drawn.values())
    texts = Counter((plan.controller_name, plan.simulator.dynamics) for plan in first)
    assert {name for name, _ in texts} == set(OUR_LAWS)
    assert {name for (name, _), count in texts.items() if count > 1} == {"computed_torque"}
    assert max(texts.values()) == 2
    assert len({kernel.text for kernel in drawn}) == len(drawn)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
def test_long_runs_have_a_steady_state(name, device):
    """Runs that a fall ends have another: when it begins follows from where they end."""
    settings = [*DISTURBED, "simulator.fall.stop=true", "simulator.fall.angle=1.2"]
    plans = several(name, settings, duration=4.0)
    plans = [
        replace(
            plan,
            disturbance=replace(
                plan.disturbance, pulse_start_times=(2.5,), pulse_magnitude=2.0 * 2.0**i
            ),
        )
        for i, plan in enumerate(plans)
    ]
    outcomes = device.run(*kernel_and_words(plans))
    wrong, _ = differences(plans, outcomes)
    assert not wrong
    lengths = set(outcomes.states[np.isfinite(outcomes.metrics[2])].tolist())
    assert 2001 in lengths
    assert len(lengths) > 1, "falls after more than two seconds"


def test_metrics_beyond_the_numbers_are_left_to_the_cpu(device):
    plans = several("pid", ["simulator.max_effort=50.0"], count=4)
    large = replace(plans[2].controller, reference_profile="constant", reference_value=1e200)
    plans[2] = replace(plans[2], controllers={"pid": large})
    outcomes = device.run(*kernel_and_words(plans))
    wrong, fates = differences(plans, outcomes)
    assert not wrong
    assert fates == {SOUND: 3, UNSOUND: 1}
    assert summary_in(outcomes, 2) is None
    assert summary_of(plans[2]).refused


# Columns --------------------------------------------------------------------------------------------------


def stacked(values):
    """Return the values of several runs as those of a single run, with columns where they differ."""
    first = values[0]
    if isinstance(first, tuple):
        items = [stacked(items) for items in zip(*values, strict=True)]
        return first._make(items) if hasattr(first, "_make") else tuple(items)
    if isinstance(first, np.ndarray):
        if all(np.array_equal(first, value) for value in values):
            return first
        whole = np.empty(first.shape, object)
        for place in np.ndindex(first.shape):
            whole[place] = stacked([value[place].item() for value in values])
        return whole
    return first if all(value == first for value in values) else Varied(np.array(values))


@pytest.mark.parametrize("name", ["pid", "fuzzy_pid"])
def test_columns_are_as_good_as_single_plans(name, device):
    plans = several(name, DISTURBED)
    kernel, words = kernel_and_words(plans)
    start = stacked([start_of_run(plan) for plan in plans])
    assert kernel_of(plans[0], start) is kernel
    joined = words_of(kernel, [(start, len(plans))])
    assert np.array_equal(joined.rows, words.rows)
    same = joined.common == words.common
    arrays = [place for place in np.flatnonzero(~same) if words.rows[place] < 0]
    assert len(joined.own) == len(words.own) < 20
    mixed = words_of(
        kernel,
        [
            (stacked([start_of_run(plan) for plan in plans[:5]]), 5),
            *((start_of_run(plan), 1) for plan in plans[5:]),
        ],
    )
    expected = device.run(kernel, words)
    wrong, _ = differences(plans, expected)
    assert not wrong
    for other in (joined, mixed):
        outcomes = device.run(kernel, other)
        assert outcomes.metrics.tobytes() == expected.metrics.tobytes()
        assert outcomes.states.tolist() == expected.states.tolist()
    assert len(arrays) <= 24, "only where arrays begin"


def test_what_all_runs_share_takes_no_column(device):
    (plan, *_) = several("pid", count=1)
    start = start_of_run(plan)
    kernel = kernel_of(plan, start)
    same = words_of(kernel, [(start, 1000)])
    assert same.own.shape == (0, 1000)
    mass = Varied(np.linspace(0.3, 0.8, 1000))
    body = start.surroundings.plant.constants._replace(trunk_mass=mass)
    plant = start.surroundings.plant._replace(constants=body)
    heavier = start._replace(surroundings=start.surroundings._replace(plant=plant))
    words = words_of(kernel, [(heavier, 1000)])
    assert words.own.view(np.float64).tolist() == [mass.values.tolist()]
    assert words_of(kernel, [(start, 3), (start, 4)]).own.shape == (0, 7)
    metrics = device.run(kernel, same).metrics.T
    assert len({run.tobytes() for run in metrics}) == 1


def test_whole_words_are_kept(device):
    """Integers beyond 2^53 too: no double is between."""
    (plan,) = several("pid", count=1)
    start = start_of_run(plan)
    many = Varied(np.array([2**62 + 1, 2**62 + 2]))
    surroundings = start.surroundings._replace(timeout_ns=many)
    words = words_of(kernel_of(plan, start), [(start._replace(surroundings=surroundings), 2)])
    assert words.own.tolist() == [[2**62 + 1, 2**62 + 2]]


def test_a_thread_draws_the_noise_of_any_seed(device):
    (plan,) = several("pid", DISTURBED, count=1)
    seeds = [0, 1, 2**31 - 1, *np.random.default_rng(2).integers(0, 2**31, 20).tolist()]
    plans = [replace(plan, simulator=replace(plan.simulator, seed=seed)) for seed in seeds]
    wrong, _ = differences(plans, device.run(*kernel_and_words(plans)))
    assert not wrong


# What a kernel does not do --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (["simulator.link.state.delay=0.01"], "links with delays or losses"),
        (["simulator.sensor.dropout=0.1"], "links with delays or losses"),
        (["pid.active.times=[0.0]"], r"a controller that acts in turns \(active.times\)"),
        (["simulator.duration=0.0"], "simulator: duration is 0: .*"),
        (["pid.autostart=false"], "pid: autostart is false, .*"),
        ([], ""),
    ],
)
def test_why_a_plan_is_unfit(settings, reason):
    plan = make_plan("fig8", "pid", settings=settings)
    assert re.fullmatch(reason, unfit(plan))


def test_several_controllers_are_unfit():
    plans = map(random_plan, range(100))
    several_act = [plan for plan in plans if len(plan.controllers) > 1]
    assert "several controllers" in {unfit(plan) for plan in several_act}


def test_a_law_outside_of_the_subset_is_unfit(monkeypatch):
    def rounded(before, effort, plant):
        return round(before + effort)

    tried = []
    translated = kernel_module._translated
    monkeypatch.setattr(kernel_module, "torque_of", rounded)
    monkeypatch.setattr(kernel_module, "_kernel", cache(kernel_module._kernel.__wrapped__))
    monkeypatch.setattr(
        kernel_module, "_translated", lambda *of: tried.append(of) or translated(*of)
    )
    reasons = [unfit(make_plan("fig8", "pid")) for _ in range(3)]
    assert reasons[0].startswith("pid: ")
    assert "round(before + effort): rounds halves to even numbers" in reasons[0]
    assert "\n" not in reasons[0]
    assert len(set(reasons)) == len(tried) == 1


def test_the_text_is_what_nvrtc_takes(drawn):
    """No header; no function of the host; no infinite number where nothing can be computed."""
    for kernel in drawn:
        assert "#include" not in kernel.text
        assert not re.search(r"(?m)^static (?!__device__ )", kernel.text)
        statics = re.findall(r"(?m)^static [^(]*=[^;]*;", kernel.text)
        assert statics
        assert not [text for text in statics if "INFINITE" in text or "NOT_A_NUMBER" in text]
        assert "__int128" not in kernel.text


# Broken on purpose ----------------------------------------------------------------------------------------


def _fuses() -> bool:
    flags = Path("/proc/cpuinfo")
    return flags.exists() and " fma " in flags.read_text()


@pytest.mark.slow
@pytest.mark.skipif(not _fuses(), reason="this processor has no fused multiply-add")
def test_a_fused_product_and_sum_is_noticed(tmp_path):
    plans = several("pid")
    outcomes = CppDevice(tmp_path, [*FLAGS, *FUSED]).run(*kernel_and_words(plans))
    wrong, _ = differences(plans, outcomes)
    assert len(wrong) > 6


@pytest.mark.slow
def test_sums_in_another_order_are_noticed(device):
    plans = several("pid")
    kernel, words = kernel_and_words(plans)
    other = r"iae = \2 * \3 + (\1 + \2 * \4)"
    text = re.sub(r"iae = (.*) \+ \((\w+) \* \((\w+) \+ (\w+)\)\)", other, kernel.text)
    assert text != kernel.text
    outcomes = device.run(Kernel(text, kernel.start), words)
    wrong, _ = differences(plans, outcomes)
    assert len(wrong) > 6
