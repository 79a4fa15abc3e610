"""A user's own hip path: every way to run it gives the same bits, and its recording verifies."""

from dataclasses import replace

import numpy as np
import pytest
from ros2_ws.src.trunk_runs.test.stepwise import steps

import trunk_experiments.api as trunk
from trunk_runs.plan import make_plan
from trunk_studies.batch.block import key_of, regular_run, summaries, summary_of
from trunk_studies.batch.lanes import LANES
from trunk_studies.tuning.floquet import floquet

GAIT = [
    "simulator.path.amplitude=0",
    "simulator.path.wavenumber=4.5",
    "simulator.path.cosines=[0.004, -0.012, 0.001]",
    "simulator.path.sines=[-0.003, 0.02]",
]
MODEL = [one.replace("simulator.path.", "computed_torque.model.path_") for one in GAIT]


def walk(controller="pid", *settings, duration=0.4):
    given = [*GAIT, *(MODEL if controller == "computed_torque" else ()), *settings]
    everywhere = {"duration": duration, "update_rate": 1000.0}
    return make_plan("fig6", controller, settings=given, everywhere=everywhere)


def states(plan):
    return [step.truth for step in steps(plan)]


def test_one_sine_is_the_default_path():
    default = make_plan("fig6", "fuzzy_pid", everywhere={"duration": 0.5})
    settings = ["simulator.path.amplitude=0.0", "simulator.path.sines=[1.0]"]
    series = make_plan("fig6", "fuzzy_pid", settings=settings, everywhere={"duration": 0.5})
    assert series.simulator.constants != default.simulator.constants
    assert states(series) == states(default)


def test_a_path_moves_the_trunk():
    flat = walk("pid", "simulator.path.cosines=[]", "simulator.path.sines=[]")
    assert states(walk())[-1] != states(flat)[-1]
    other = walk("computed_torque", "computed_torque.model.path_sines=[]")
    assert states(walk("computed_torque"))[-1] != states(other)[-1], "the model's path, too"


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_runs_share_blocks_by_their_number_of_harmonics():
    paths = [(0.01,), (0.01, 0.02), (), (0.01, 0.02, 0.0)]
    plans = [
        replace(
            one, simulator=replace(one.simulator, sines=paths[i % 4], trunk_mass=0.5 + 0.002 * i)
        )
        for i in range(4 * LANES)
        for one in [walk()]
    ]
    assert len({key_of(regular_run(plan)) for plan in plans}) == 3, (
        "a zero at the end is not a harmonic"
    )
    found = summaries(plans)
    assert found == [summary_of(plan) for plan in plans]
    assert len(set(found)) == len(found)


@pytest.mark.slow
def test_the_library_takes_a_path(tmp_path):
    given = {"simulator.path.sines": np.array([0.01, 0.02]), "simulator.path.cosines": [0.003]}
    run = trunk.simulate(trunk.plan("fig6", "pid", overrides=given, duration=0.1))
    assert run.parameters["simulator"]["path.sines"] == (0.01, 0.02)
    assert trunk.verify(run).verified


@pytest.mark.slow
@pytest.mark.one_in(8)
def test_floquet_multipliers_are_those_of_the_same_path_as_a_sine():
    settings = ["simulator.hip.mode=prescribed", "simulator.path.wavenumber=9"]
    sine = walk("pid", *settings, "simulator.path.cosines=[]", "simulator.path.sines=[0.05]")
    amplitude = replace(sine.simulator, amplitude=0.05, sines=())
    found, expected = floquet(sine), floquet(replace(sine, simulator=amplitude))
    assert found.period == expected.period > 0.5
    assert np.array_equal(found.multipliers, expected.multipliers)
    shaken = replace(sine.simulator, sines=(0.05, 0.05))
    assert floquet(replace(sine, simulator=shaken)).growth != expected.growth
