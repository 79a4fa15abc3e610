"""A page's recording is the command's: the same bytes where both write uncompressed, identical, verified."""

from __future__ import annotations

import hashlib
import math
import random
import re
import struct
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from trunk_experiments.plans.plan import RunPlan, make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.branch import Branch, branch_plan, record_branch
from trunk_experiments.replay.diff import diff
from trunk_experiments.replay.verify import UNJUDGED, VERIFIED, verdict_on
from trunk_experiments.runs import offline_recording
from trunk_experiments.runs.offline_recording import OfflineRecorder, record_offline
from trunk_msgs_util.recording import writer as recording_writer
from trunk_msgs_util.recording.digests import DIGESTS, PROVENANCE
from trunk_sim.operator_input import Applied
from trunk_sim.simulation import DivergedError

from .page_recording import (
    ASSETS,
    DIGEST,
    HERE,
    Computed,
    computed,
    differences,
    needs_node,
    page_recording,
)

pytestmark = needs_node
SHORT = {"duration": 0.6}
NOISY = ("simulator.sensor.position_noise=0.002", "simulator.sensor.velocity_noise=0.01")

FALLING = ("simulator.initial.position=[0, 1.2]", "pid.gains.p=1", "pid.gains.d=0.0")
CELLS = ("fuzzy_pid.rules.kp.ZO.ZO=B", "fuzzy_pid.rules.alpha.PB.NB=3.25")


def metadata(path: Path, name: str) -> dict[str, str]:
    with path.open("rb") as file:
        return next(m.metadata for m in make_reader(file).iter_metadata() if m.name == name)


def same_bytes(page: Path, plan: RunPlan, run: Computed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that our own writer makes the page's bytes of a run, told the page's origin."""
    with page.open("rb") as file:
        library = make_reader(file).get_header().library
    origin = metadata(page, PROVENANCE)
    monkeypatch.setattr(offline_recording.provenance, "gather", lambda **_: origin)
    monkeypatch.setattr(recording_writer, "_LIBRARY", library)
    path = page.with_name("uncompressed.mcap")
    error = DivergedError(run.reason)

    def states():
        yield from run.states
        if run.ended == "diverged":
            raise error

    with recording_writer.RecordingWriter(path, "none") as writer:
        recorder = OfflineRecorder(plan, tuple(plan.controllers), writer)
        recorder.open()
        recorder.write_all(states(), lambda done, of: None)
    assert page.read_bytes() == path.read_bytes()


def same_run(page: Path, ours: Path, outcome: int = VERIFIED) -> None:
    """Assert that `trunk diff` finds two files identical, and that `trunk verify` verifies the page's."""
    run = RecordedRun.open(page)
    difference = diff(RecordedRun.open(ours), run)
    assert difference.identical
    assert difference.same_plan
    assert difference.record == []
    assert difference.parameters == []
    verdict = verdict_on(run)
    assert verdict.exit_code == outcome, verdict
    assert not verdict.altered


@pytest.mark.slow
@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("scenario", "controller", "settings"),
    [
        ("fig6", "pid", ()),
        ("fig7", "lqr", ()),
        ("fig8", "fuzzy_pid", ()),
        ("fig8", "computed_torque", NOISY),
        ("fig9", "computed_torque", ()),
        ("demo", "fuzzy_pid", NOISY),
        ("demo", "fuzzy", ("simulator.fall.angle=inf",)),
        ("demo", "pid", ("pid.update_rate=100", "simulator.sensor.delay=0.035")),
    ],
)
def test_a_whole_run_is_the_commands(scenario, controller, settings, tmp_path, monkeypatch):
    plan = make_plan(scenario, controller, settings=settings)
    run = computed(plan)
    page = page_recording(plan, run, tmp_path)
    record_offline(plan, tmp_path / "ours.mcap")
    same_run(page, tmp_path / "ours.mcap")
    same_bytes(page, plan, run, monkeypatch)


@pytest.mark.parametrize(
    ("scenario", "controller", "settings"),
    [
        ("fig8", "fuzzy_pid", (*CELLS, "fuzzy_pid.gains.p_max=77.25", "fuzzy_pid.u_clamp_max=40")),
        ("fig9", "lqr", ("simulator.plant.length=0.9", "simulator.sensor.seed=7", *NOISY)),
        (
            "demo",
            "pid",
            ("disturbance.sine.amplitude=5", "simulator.initial.position=[0, 0.1]"),
        ),
    ],
)
def test_changed_values_are_recorded(scenario, controller, settings, tmp_path, monkeypatch):
    base = make_plan(scenario, controller, everywhere=SHORT)
    plan = make_plan(scenario, controller, everywhere=SHORT, settings=settings)
    run = computed(plan)
    page = page_recording(base, run, tmp_path, {"values": differences(base, plan)})
    record_offline(plan, tmp_path / "ours.mcap")
    same_run(page, tmp_path / "ours.mcap")
    same_bytes(page, plan, run, monkeypatch)


def test_without_any_disturbance_there_is_no_node_of_it(tmp_path, monkeypatch):
    base = make_plan("fig8", "pid", everywhere=SHORT)
    plan = make_plan("fig8", "pid", everywhere=SHORT, settings=("disturbance.pulse.magnitude=0",))
    assert plan.disturbance is None
    run = computed(plan)
    values = {"disturbance": {"pulse.magnitude": 0.0}}
    same_bytes(page_recording(base, run, tmp_path, {"values": values}), plan, run, monkeypatch)


@pytest.mark.parametrize(
    ("at", "settings"),
    [
        (0.3, ("pid.gains.p=90", "disturbance.pulse.magnitude=0.2", "simulator.plant.gravity=3.7")),
        (0.0, ("pid.gains.d=7.5", "simulator.plant.trunk_mass=0.75", "pid.gains.p=60.0")),
        (0.6, ("simulator.fall.angle=1.0", "pid.gains.i=0")),
        (0.3, ("pid.gains.p=60",)),  # as it is
    ],
)
def test_a_branch_is_recorded(at, settings, tmp_path, monkeypatch):
    plan = make_plan("fig8", "pid", everywhere=SHORT)
    record_offline(plan, tmp_path / "parent.mcap")
    parent = RecordedRun.open(tmp_path / "parent.mcap")
    branch = Branch(at, settings)
    made = branch_plan(parent, branch)
    record_branch(parent, branch, made, tmp_path / "branch.mcap")
    changed = replace(plan, changes=made.changes)
    values = {
        node: dict(change.values or {})
        for node, changes in changed.changes.items()
        for change in changes
    }
    run = computed(changed)
    setup = {"branch": {"at_ns": round(at * 1e9), "values": values or {"pid": {"gains.p": 60}}}}
    page = page_recording(plan, run, tmp_path, setup)
    same_run(page, tmp_path / "branch.mcap")
    same_bytes(page, changed, run, monkeypatch)


@pytest.mark.parametrize("at", [0.0, 0.3])
def test_a_disturbance_begins_with_a_branch(at, tmp_path):
    base = make_plan("fig8", "pid", everywhere=SHORT)
    quiet = {"pulse.magnitude": 0.0, "pulse.start_times": [0.2, 0.4]}
    settings = [f"disturbance.{name}={value}" for name, value in quiet.items()]
    record_offline(
        make_plan("fig8", "pid", everywhere=SHORT, settings=settings), tmp_path / "parent.mcap"
    )
    parent = RecordedRun.open(tmp_path / "parent.mcap")
    branch = Branch(at, (*settings[1:], "disturbance.pulse.magnitude=0.5"))
    made = branch_plan(parent, branch)
    record_branch(parent, branch, made, tmp_path / "branch.mcap")
    after = {"disturbance": {"pulse.magnitude": 0.5}}
    change = offline_recording.Change(round(at * 1e9) - 1, after["disturbance"])
    start = replace(base.disturbance, pulse_magnitude=0.0, pulse_start_times=(0.2, 0.4))
    run = computed(replace(base, disturbance=start, changes={"disturbance": [change]}))
    setup = {
        "values": {"disturbance": quiet},
        "branch": {"at_ns": round(at * 1e9), "values": after},
    }
    same_run(page_recording(base, run, tmp_path, setup), tmp_path / "branch.mcap")


def test_values_of_another_controller_are_not_recorded(tmp_path, monkeypatch):
    plan = make_plan("fig8", "pid", everywhere=SHORT)
    run = computed(plan)
    values = {"lqr": {"gains.p": 1.0}, "disturbance": {}}
    setup = {"values": values, "branch": {"at_ns": 100_000_000, "values": values}}
    same_bytes(page_recording(plan, run, tmp_path, setup), plan, run, monkeypatch)


def test_a_fall_after_a_branch_names_the_limit_in_force(tmp_path, monkeypatch):
    plan = make_plan("fig8", "pid", everywhere=SHORT, settings=FALLING)
    change = offline_recording.Change(100_000_000, {"fall.angle": 1.75})
    changed = replace(plan, changes={"simulator": [change]})
    run = computed(changed)
    assert [part.first for part in run.states if part.falls] == [101]
    branch = {"at_ns": 100_000_000, "values": {"simulator": {"fall.angle": 1.75}}}
    page = page_recording(plan, run, tmp_path, {"branch": branch})
    same_bytes(page, changed, run, monkeypatch)


def test_pushes_by_hand_are_on_their_topic(tmp_path):
    everywhere = {"duration": 5.0, "operator.torque": 30.0, "operator.force": 50.0}
    plan = make_plan("fig8", "pid", everywhere=everywhere)
    pushes = [(0, -10.5, 0.0), (50_000_000, 0.0, 30.0), (4_200_000_000, 1.25, -30.0)]
    pushed = replace(plan, pushes=[(ns, Applied(*efforts)) for ns, *efforts in pushes])
    page = page_recording(plan, computed(pushed), tmp_path, {"pushes": pushes})
    record_offline(pushed, tmp_path / "ours.mcap")
    same_run(page, tmp_path / "ours.mcap")
    ours, theirs = (metadata(path, DIGESTS) for path in (tmp_path / "ours.mcap", page))
    of_origin = ("metadata", "header")
    assert "/operator/push" in theirs
    assert {k: v for k, v in theirs.items() if k not in of_origin} == {
        k: v for k, v in ours.items() if k not in of_origin
    }


def test_a_fall_can_end_a_run(tmp_path, monkeypatch):
    settings = (*FALLING, "simulator.fall.stop=true")
    plan = make_plan("fig8", "pid", everywhere=SHORT, settings=settings)
    run = computed(plan)
    assert run.ended == "fell"
    page = page_recording(plan, run, tmp_path)
    record_offline(plan, tmp_path / "ours.mcap")
    same_run(page, tmp_path / "ours.mcap")
    same_bytes(page, plan, run, monkeypatch)


def test_a_fall_in_the_last_state_need_not_end_a_run(tmp_path, monkeypatch):
    plan = make_plan("fig8", "pid", everywhere=SHORT, settings=FALLING)
    (row,) = (part.first + row for part in computed(plan).states for row in part.falls)
    plan = make_plan("fig8", "pid", everywhere={"duration": row / 1000}, settings=FALLING)
    run = computed(plan)
    same_bytes(page_recording(plan, run, tmp_path), plan, run, monkeypatch)


def test_a_run_that_diverges_is_incomplete(tmp_path, monkeypatch):
    everywhere = {"duration": 1.0, "update_rate": 200.0}
    plan = make_plan("fig6", "pid", everywhere=everywhere, settings=("pid.gains.d=900.0",))
    run = computed(plan)
    assert run.ended == "diverged"
    page = page_recording(plan, run, tmp_path)
    with pytest.raises(DivergedError):
        record_offline(plan, tmp_path / "ours.mcap")
    same_run(page, tmp_path / "ours.mcap", UNJUDGED)
    same_bytes(page, plan, run, monkeypatch)


def test_every_reader_may_check_it(tmp_path):
    plan = make_plan("fig8", "pid", everywhere=SHORT)
    page = page_recording(plan, computed(plan), tmp_path)
    with page.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        counted = sum(1 for _ in reader.iter_messages())
    assert summary is not None
    assert summary.statistics is not None
    assert counted == summary.statistics.message_count > 600 * 4


def test_the_origin_is_told(tmp_path, trunk):
    plan = make_plan("demo", "pid", everywhere=SHORT)
    page = page_recording(plan, computed(plan), tmp_path)
    _, shown, _ = trunk("info", page)
    assert re.search("recorded by +trunk_experiments [0-9.]+, in a browser", shown)
    assert re.search("made_by +browser", shown)
    assert re.search(rf"page\s+{DIGEST}", shown)
    code, judged, _ = trunk("verify", page)
    assert code == VERIFIED
    assert f"computed in a browser, by the page {DIGEST[:12]}…" in judged


@pytest.mark.parametrize("seed", range(4))
def test_digests_are_the_standards(seed, tmp_path):
    rng = random.Random(seed)
    sizes = [rng.choice((0, 1, 31, 127, 128, 129, 150, 300)) for _ in range(12)]
    data = rng.randbytes(sum(sizes) + rng.choice((0, 1, 128, 1000)))
    (tmp_path / "data").write_bytes(data)
    command = ["node", str(HERE / "digests.mjs"), str(ASSETS), str(tmp_path / "data")]
    printed = subprocess.run(
        [*command, *map(str, sizes)], check=True, capture_output=True, text=True
    ).stdout
    digest = hashlib.blake2b(data, digest_size=32).hexdigest()
    assert printed.split() == [digest, str(zlib.crc32(data))]


@pytest.mark.parametrize("seed", range(2))
def test_doubles_are_printed_as_here(seed):
    rng = random.Random(seed)
    values = [0.0, -0.0, 12.25, -12.35, 0.125, 1.0005, 1e16, 9.995, 999.5, 1e-4, 9.9999e-5, 5e-324]
    values += [struct.unpack("<d", rng.randbytes(8))[0] for _ in range(150)]
    values += [rng.uniform(-1.0, 1.0) * 10.0 ** rng.randint(-6, 18) for _ in range(150)]
    values += [rng.randrange(4000) / 8 for _ in range(150)]
    values = [value for value in values if math.isfinite(value)]
    words = [struct.pack(">d", value).hex() for value in values]
    command = ["node", str(HERE / "numbers.mjs"), str(ASSETS), *words]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert printed.splitlines() == [f"{value!r} {value:g} {value:.3g}" for value in values]
