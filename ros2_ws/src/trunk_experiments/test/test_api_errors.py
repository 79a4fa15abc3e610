"""The library refuses every wrong argument with one line, in an error of its own family."""

import errno
import os
from types import SimpleNamespace

import pytest

import trunk_experiments.api as trunk

ONE = {"mass": trunk.grid("simulator.plant.trunk_mass", [0.4])}


def study(**changed):
    given = {"scenario": "fig6", "controllers": ["pid"], "vary": ONE, "duration": 0.2}
    return trunk.study(**{**given, **changed})


MISTAKES = {
    "scenario": (lambda: trunk.plan("fig88"), "no scenario 'fig88'.*did you mean 'fig8'"),
    "no name": (lambda: trunk.plan(8), "scenario 8 is not a path: give a string"),
    "controller": (lambda: trunk.plan("fig8", "pidd"), "no controller 'pidd'.*did you mean 'pid'"),
    "file": (lambda: trunk.plan("fig8", params="pid_as"), "no parameter file 'pid_as'"),
    "files": (lambda: trunk.plan("fig8", params=[3]), "params 3 is not a path"),
    "texts": (lambda: trunk.plan("fig8", overrides=["pid.gains.p=1"]), "a mapping is needed"),
    "target": (
        lambda: trunk.plan("fig8", overrides={"simulatr.plant.length": 1.0}),
        "overrides: 'simulatr.plant.length': NODE.PARAM is needed.*did you mean 'simulator'",
    ),
    "other node": (
        lambda: trunk.plan("fig8", overrides={"pid.gains.p": 1.0}),
        "overrides: 'pid.gains.p': pid is not in this run: give one of simulator",
    ),
    "kind": (
        lambda: trunk.plan("fig8", overrides={"simulator.plant.length": {"a": 1}}),
        "plant.length: .* is not allowed",
    ),
    "duration": (lambda: trunk.plan("fig8", duration=-1.0), "duration: simulator: .*': -1.0"),
    "rate": (lambda: trunk.plan("fig8", rate=[1.0]), r"rate \[1.0\]: a number is needed"),
    "swap": (
        lambda: trunk.plan("fig8", swaps=["4:pid"]),
        "swaps: '4:pid': a time in s and .*; controllers: .*pid",
    ),
    "swap's controller": (
        lambda: trunk.plan("fig8", swaps=[(4.0, "pd")]),
        "swaps: .*did you mean 'pid'",
    ),
    "swaps": (lambda: trunk.plan("fig8", swaps=3), "swaps 3: a list is needed"),
    "null": (lambda: trunk.load("a\0b"), "is not a path"),
    "too long": (lambda: short().save("x" * 300 + ".yaml"), "File name too long"),
    "folder of results": (lambda: trunk.load_sweep("."), "a folder: give a Parquet file"),
    "nodes": (lambda: trunk.parameters(["pid"]), r"no node \['pid'\]"),
    "one name": (
        lambda: trunk.plot("a.mcap", names=3),
        "names 3: give a list of 1, one for each run",
    ),
    "varied": (lambda: study(vary=[ONE]), "vary .*: a mapping is needed"),
    "no plan": (lambda: trunk.simulate("fig8"), "simulate: 'fig8' is not a plan"),
    "endless": (
        lambda: trunk.simulate(trunk.plan("fig8", duration=0.0)),
        "duration is 0: an offline run needs an end",
    ),
    "nothing to search on": (trunk.optimise, "give one or more of what trunk.plan"),
    "two controllers": (
        lambda: trunk.optimise(trunk.plan("fig6", "pid"), trunk.plan("fig6", "lqr")),
        "controllers are lqr, pid: give plans of one controller",
    ),
    "searched metric": (
        lambda: trunk.optimise(trunk.plan("fig6", "pid"), metric="itea"),
        "optimise: metric 'itea': one of .*did you mean 'itae'",
    ),
    "generations": (
        lambda: trunk.learn(study(), "pid", generations=0),
        "learn: generations 0: a whole number from 1 to 100000 is needed",
    ),
    "draws": (lambda: trunk.learn("rules", "pid"), "learn: 'rules' is not a study"),
    "held-out draws": (
        lambda: trunk.learn(study(runs=2), "pid", held_out_seed=1),
        "the held-out draws must be others",
    ),
    "lag": (lambda: trunk.relay("20ms", 0.5), "relay: lag '20ms': a number from 0 to 1000"),
    "no recording": (lambda: trunk.load("nothing.mcap"), "nothing.mcap"),
    "no path": (lambda: trunk.metrics(3), "recording 3 is not a path"),
    "no runs": (trunk.plot, "plot: no run"),
    "figure": (lambda: trunk.plot("a.mcap", fig=3), "fig is 3: one of 6, 7, 8, 9"),
    "names": (
        lambda: trunk.plot("a.mcap", names="ab"),
        "names 'ab': give a list of 1, one for each run",
    ),
    "no study": (lambda: trunk.sweep("robustness"), "sweep: 'robustness' is not a study"),
    "study's name": (lambda: trunk.read_study("robust"), "no study 'robust'.*did you mean"),
    "jobs": (lambda: trunk.sweep(study(), jobs=0), "jobs is 0: a whole number from 1 to 1024"),
    "vary": (lambda: study(vary={"m": [0.4]}), r"vary: m: \[0.4\]: give trunk.grid"),
    "column": (lambda: study(vary={"iae 2": ONE["mass"]}), "vary.iae 2: is not a column name"),
    "runs": (lambda: study(runs=0.5), "runs: is 0.5: a whole number"),
    "contender": (lambda: study(controllers={"a": "pid"}), "controllers: 'pid' is not a contender"),
    "no controller": (lambda: study(controllers=["pidd"]), "controllers.pidd"),
    "object": (
        lambda: study(vary={"m": trunk.grid("simulator.plant.length", [object()])}),
        "study: ",
    ),
    "distribution": (
        lambda: study(vary={"m": trunk.draw("simulator.plant.length", "uniform", low=1.0)}),
        "vary.m: distribution uniform: high is missing",
    ),
    "unknown parameter": (
        lambda: trunk.sweep(study(vary={"m": trunk.grid("simulator.plant.lenght", [1.0])})),
        "did you mean 'plant.length'",
    ),
    "study's override": (
        lambda: trunk.sweep(study(overrides={"simulator.plant.lenght": 1.0})),
        "study: pid: set simulator.plant.lenght=1.0: .*did you mean 'plant.length'",
    ),
    "study's target": (
        lambda: trunk.sweep(study(overrides={"simulatr.plant.length": 1.0})),
        "study: pid: set 'simulatr.plant.length=1.0': NODE.PARAM=VALUE is needed",
    ),
    "results": (lambda: trunk.load_sweep("nothing.parquet"), "there is no such file"),
    "column of results": (lambda: trunk.sweep(study())["iaee"], "no column 'iaee': one of run"),
    "one of results": (lambda: trunk.sweep(study()).of("lqr"), "no controller 'lqr'.*one of pid"),
    "map": (
        lambda: trunk.sweep(study()).map("mass", "mass"),
        "x and y are both 'mass': give two different grids",
    ),
    "node": (lambda: trunk.parameters("simulatr"), "no node 'simulatr'.*did you mean 'simulator'"),
}


def short():
    return trunk.plan("fig6", "pid", duration=0.1)


@pytest.mark.parametrize(("call", "says"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line(call, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(trunk.TrunkError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert "--" not in str(caught.value), "an option of the command line"
    assert list(tmp_path.iterdir()) == []


WRITERS = {
    "run.mcap": lambda path, made, **more: trunk.simulate(short(), output=path, **more),
    "copy.mcap": lambda path, made, **more: made.run.save(path, **more),
    "plan.yaml": lambda path, made, **more: short().save(path, **more),
    "picture.png": lambda path, made, **more: made.picture.save(path, **more),
    "sweep.parquet": lambda path, made, **more: trunk.sweep(study(), output=path, **more),
    "results.parquet": lambda path, made, **more: made.results.save(path, **more),
}


@pytest.fixture(scope="module")
def made():
    run = trunk.simulate(short())
    return SimpleNamespace(run=run, picture=trunk.plot(run), results=trunk.sweep(study()))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "write"), WRITERS.items(), ids=WRITERS)
def test_nothing_writes_over_a_file_unasked(name, write, made, tmp_path):
    path = tmp_path / name
    path.write_text("mine")
    with pytest.raises(trunk.PlanError, match="it exists: give another name, or overwrite=True"):
        write(path, made)
    assert path.read_text() == "mine"
    write(path, made, overwrite=True)
    assert path.read_bytes() != b"mine"
    for wrong, says in (
        (tmp_path / "a.txt", "must end in"),
        (tmp_path / "no" / name, "no folder"),
        (tmp_path, "is a folder"),
        (7, "not a path"),
    ):
        with pytest.raises(trunk.PlanError, match=says):
            write(wrong, made)
    assert [one.name for one in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(("name", "write"), WRITERS.items(), ids=WRITERS)
def test_a_full_disk_is_one_line_and_leaves_no_file(name, write, made, tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(trunk.PlanError, match=f"output .*{name}: No space left on device"):
        write(tmp_path / name, made)
    assert not (tmp_path / name).exists()


def test_a_recording_is_not_copied_over_itself(tmp_path):
    run = trunk.simulate(short(), output=tmp_path / "run.mcap")
    before = run.path.read_bytes()
    with pytest.raises(trunk.PlanError, match="is read by"):
        run.save(tmp_path / "run.mcap", overwrite=True)
    assert run.path.read_bytes() == before
