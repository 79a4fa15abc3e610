"""A run continued by compiled code has the states that CPython gives it, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from trunk_experiments.branching.branch import Branch
from trunk_experiments.branching.change import branched
from trunk_experiments.branching.resume import resumed, state_at
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.turns import Swap
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.runs import going_on
from trunk_experiments.runs.offline_recording import record_offline

pytest.importorskip("numba")

NOISE = "simulator.sensor.velocity_noise=0.02"
PARENTS = {
    "plain": {"settings": (NOISE,)},
    "turns": {"swaps": (Swap(0.3, "lqr"), Swap(0.7, "pid"))},
    "falls": {"settings": (NOISE, "simulator.max_effort=1", "simulator.fall.angle=20deg")},
}


@pytest.fixture(scope="module")
def parents(tmp_path_factory):
    made = {}
    folder = tmp_path_factory.mktemp("going_on")
    for name, more in PARENTS.items():
        made[name] = folder / f"{name}.mcap"
        record_offline(make_plan("demo", "pid", everywhere={"duration": 1.0}, **more), made[name])
    return {name: RecordedRun.open(path) for name, path in made.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parent", "branch", "compiled"),
    [
        ("plain", Branch(0.5), True),
        ("plain", Branch(0.0, ("pid.gains.p=95",)), True),
        ("plain", Branch(0.402, ("pid.gains.p=95", "simulator.max_effort=9")), True),
        ("plain", Branch(0.5, ("disturbance.sine.amplitude=25",)), True),
        ("plain", Branch(0.5, (), "lqr"), True),
        ("plain", Branch(0.5, (), "", ("60Nm:0.1s",)), True),
        ("turns", Branch(0.2, ("pid.gains.p=95",)), True),
        ("turns", Branch(0.3), True),
        ("turns", Branch(0.5, ("pid.gains.d=9",)), True),
        ("turns", Branch(0.8, (), "lqr"), False),  # not as the schedule says
        ("falls", Branch(0.1), True),
        ("falls", Branch(0.9), True),
    ],
)
def test_both_give_the_same_states(monkeypatch, parents, parent, branch, compiled):
    found = {}
    ready = going_on.compiled_states_from
    for quick in (False, True):
        used = []

        def compiled_states(*given, used=used):
            states = ready(*given)
            used.append(True)
            return states

        monkeypatch.setattr(going_on, "worth_compiling", lambda *_, quick=quick: quick)
        monkeypatch.setattr(going_on, "compiled_states_from", compiled_states)
        run = parents[parent]
        made = branched(run, resumed(run, state_at(run, branch.at)), branch, None).resumed
        found[quick] = list(going_on.states_from(made.plan, made.begun))
        assert bool(used) == (quick and compiled)
    assert joined(found[True]) == joined(found[False])


def joined(some):
    """Return the states of consecutive stretches in a form that can be compared."""
    width = max(part.table.shape[1] for part in some)
    rows = [np.pad(part.table, ((0, 0), (0, width - part.table.shape[1]))) for part in some]
    acts: list[tuple[int, str]] = []
    for part in some:
        for row, name in part.acts:
            if not acts or acts[-1][1] != name:
                acts.append((part.first + row, name))
    turned = [(part.first + row, *rest) for part in some for row, *rest in part.turned]
    falls = [part.first + row for part in some for row in part.falls]
    told = {name: names for part in some for name, names in part.told.items()}
    return some[0].first, np.concatenate(rows).tobytes(), acts, turned, falls, told
