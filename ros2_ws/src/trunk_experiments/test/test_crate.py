"""A crate names every file with its hash, the code with its version, and holds only verified recordings."""

from __future__ import annotations

import json
from hashlib import sha256

import pytest
import yaml

from trunk_experiments.errors import CrateError
from trunk_experiments.paper import crate
from trunk_experiments.paper.reproduction import Reproduction
from trunk_experiments.paper.runs import FIGURES, PROFILES, Case, PaperRun, cases
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import provenance

pytest.importorskip("rocrate")

CASE = Case(PROFILES[1], "fig6", "pid_ziegler_nichols")


class OneRun(Reproduction):
    """A reproduction of one run that ended; the others diverged, so that there is nothing to verify."""

    def verdicts(self):
        return []


@pytest.fixture
def result():
    runs = {case: PaperRun(case, None, 0.0, "diverged") for case in cases()}
    return OneRun(runs={**runs, CASE: PaperRun(CASE, object(), 0.0)})


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "runs").mkdir()
    plan = CASE.plan(duration=0.2)
    record_offline(plan, tmp_path / "runs" / f"{CASE.stem}.mcap")
    names = [f"{figure}{suffix}" for figure in FIGURES for suffix in (".png", ".svg")]
    for name in ("report.html", "paper.json", *names):
        (tmp_path / name).write_text(name)
    return tmp_path


def test_a_crate_says_what_is_in_it(result, folder):
    begun = provenance.gather(commit="0123abc+dirty")
    path = crate.write_crate(result, folder, begun, lambda step: None)
    graph = {one["@id"]: one for one in json.loads(path.read_text(encoding="utf-8"))["@graph"]}
    files = {name: one for name, one in graph.items() if one["@type"] == "File"}
    held = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    assert set(files) == held - {path.name}
    for name, one in files.items():
        assert one["sha256"] == sha256((folder / name).read_bytes()).hexdigest(), name
    assert {part["@id"] for part in graph["./"]["hasPart"]} == set(files)
    (action,) = (one for one in graph.values() if one["@type"] == "CreateAction")
    assert f"runs/{CASE.stem}.mcap" in {one["@id"] for one in action["result"]}
    assert "parameters/profile_practical.yaml" in {one["@id"] for one in action["object"]}
    tool = graph[action["instrument"]["@id"]]
    assert (tool["softwareVersion"], tool["identifier"]) == (
        begun["trunk_experiments"],
        "0123abc+dirty",
    )
    assert begun["host"] not in json.loads((folder / "provenance.json").read_text()).values()
    manifest = yaml.safe_load((folder / "codecheck.yml").read_text(encoding="utf-8"))["manifest"]
    assert {one["file"] for one in manifest} <= held
    assert "changes that no commit has" in (folder / "README.md").read_text(encoding="utf-8")


def test_a_recording_that_does_not_verify_makes_no_crate(result, folder):
    recording = folder / "runs" / f"{CASE.stem}.mcap"
    recording.write_bytes(recording.read_bytes()[:-400])
    with pytest.raises(CrateError, match=r"only recordings that verify go into a crate"):
        crate.write_crate(result, folder, provenance.gather(), lambda step: None)
    assert not (folder / "ro-crate-metadata.json").exists()


def test_without_the_library_it_is_refused_before_any_work(monkeypatch):
    monkeypatch.setattr(crate, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match="pip install rocrate"):
        crate.check_installed()
