"""Runs in which controllers take turns, and runs in which the trunk falls: recorded, judged, rebuilt."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from ros2_ws.src.trunk_recording.test.mcap_files import ANEW, NONE, copied

from trunk_core.errors import PlanError
from trunk_core.topics import Event
from trunk_evidence.differences import diff
from trunk_evidence.doctor import findings
from trunk_evidence.explanation import explain
from trunk_evidence.judgement import DIVERGES, VERIFIED, verify
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import RunTable
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan, parse_swap
from trunk_runs.timeline import Change
from trunk_views.plots import overview
from trunk_views.report_data import report_data
from trunk_views.run_view import RunView

EVENTS = "/run/events"


SWAPPED = {
    "fig8": ("pid", ["0.25:fuzzy_pid", "0.5:pid"]),
    "demo": ("fuzzy_pid", ["1.0:lqr", "1.5:computed_torque"]),
}


@pytest.mark.one_in(2)
@pytest.mark.slow
@pytest.mark.parametrize("scenario", SWAPPED)
def test_runs_in_which_controllers_take_turns(scenario, tmp_path):
    controller, swaps = SWAPPED[scenario]
    path = tmp_path / "swapped.mcap"
    plan = make_plan(
        scenario, controller, everywhere={"duration": 2.0}, swaps=list(map(parse_swap, swaps))
    )
    record_offline(plan, path)
    recording = Recording.open(path)
    verdict = verify(recording)
    assert verdict.exit_code == VERIFIED
    names = list(plan.controllers)
    assert list(RecordedRun(recording).controllers) == names
    assert [part.name for part in verdict.checks[: len(names)]] == [
        f"commands of {name}" for name in names
    ]
    turns = [
        (e.message, e.node)
        for e in recording.events("/run/events")
        if e.message.endswith("activated")
    ]
    assert [node for message, node in turns if message == "activated"] == [
        f"/{name}" for name in (controller, *(swap.split(":")[1] for swap in swaps))
    ]
    # The torque continues across each turn; what the integral cannot absorb comes in steps of 1 N m.
    table = RunTable.from_run(RecordedRun(recording))
    assert not np.isnan(table.kp).any()
    for swap in swaps:
        k = int(np.searchsorted(table.t, float(swap.split(":")[0])))
        bound = 1e-6 if table.ki[k] else 1.0 + 1e-9
        assert abs(table.torque[k] - table.torque[k - 1]) < bound
    # The output says who acted when.
    view = RunView.read(RecordedRun(recording))
    starts = [0.0, *(float(swap.split(":")[0]) for swap in swaps)]
    assert [turn.start for turn in view.turns] == starts
    assert [turn.controller for turn in view.turns][1:] == [swap.split(":")[1] for swap in swaps]
    assert all(f"from {start:g} s " in view.title for start in starts[1:])
    torque = next(a for a in overview([view]).axes if "Torque" in a.get_title(loc="left"))
    lines = [line.get_xdata()[0] for line in torque.lines if len(set(line.get_xdata())) == 1]
    assert lines == starts[1:]
    assert [text.get_text() for text in torque.texts] == [turn.controller for turn in view.turns]
    marks = report_data([view])["marks"]
    assert [mark["t"] for mark in marks if mark["kind"] == "turn"] == starts[1:]
    took_over = [explain(RecordedRun(recording), start).took_over for start in starts]
    assert took_over == [False, True, True]
    assert findings(RecordedRun.open(path)) == []  # nothing is missing between two turns


def test_a_controller_that_is_activated_during_the_run_begins_inactive(tmp_path):
    """Nothing in its parameters says so: it starts by itself, and somebody deactivated it at first."""
    path = tmp_path / "swapped.mcap"
    pid, fuzzy = (
        make_plan("fig8", name, everywhere={"duration": 0.4}) for name in ("pid", "fuzzy_pid")
    )
    at_ns = 199_000_000
    plan = replace(
        pid,
        controllers={**pid.controllers, **fuzzy.controllers},
        changes={
            "pid": [Change(at_ns, None, Event.DEACTIVATED)],
            "fuzzy_pid": [Change(at_ns, None, Event.ACTIVATED)],
        },
    )
    record_offline(plan, path)
    verdict = verify(Recording.open(path))
    assert verdict.exit_code == VERIFIED, verdict
    assert [part.steps for part in verdict.checks[:2]] == [200, 201]


@pytest.fixture(scope="module")
def swapped(tmp_path_factory):
    """Return the recording of a run in which another controller takes over at 0.5 s."""
    path = tmp_path_factory.mktemp("turns") / "swapped.mcap"
    swaps = [parse_swap("0.5:fuzzy_pid")]
    record_offline(make_plan("fig8", "pid", everywhere={"duration": 1.0}, swaps=swaps), path)
    return path


@pytest.mark.slow
def test_commands_of_two_publishers_may_be_in_any_order(swapped, tmp_path):
    def late(messages):
        """Put the first controller's last command after many of the other's."""
        commands = [i for i, message in enumerate(messages) if message[0] == "/effort_command"]
        messages.insert(commands[800], messages.pop(commands[499]))
        for number, message in enumerate(m for m in messages if m[0] == "/effort_command"):
            message[4] = number

    edited = copied(swapped, tmp_path / "edited.mcap", late, digests=ANEW)
    verdict = verify(edited)
    assert not any(part.wrong_steps for part in verdict.checks), verdict
    assert diff(RecordedRun.open(swapped), RecordedRun(edited)).identical
    assert explain(RecordedRun(edited), 0.4995).controller == "pid"


@pytest.mark.parametrize(
    ("controller", "swaps", "text"),
    [
        ("pid", ["0:fuzzy_pid"], "above 0"),
        ("pid", ["2:fuzzy_pid", "1:pid"], "ascend"),
        ("pid", ["2:pid"], "is already acting then"),
    ],
)
def test_impossible_swaps_are_refused(controller, swaps, text):
    with pytest.raises(PlanError, match=text):
        make_plan("fig8", controller, swaps=list(map(parse_swap, swaps)))


@pytest.mark.parametrize("text", ["", "4.0", "4.0:", "x:pid", "4:nobody", "nan:pid"])
def test_a_malformed_swap_is_refused(text):
    with pytest.raises(PlanError, match="T:CONTROLLER is needed"):
        parse_swap(text)


def test_a_time_without_a_controller_is_refused():
    with pytest.raises(PlanError, match=r"no controller would act at t = 1 s"):
        make_plan("fig8", "pid", settings=["pid.active.times=[0.0, 1.0]"])


def test_a_controller_with_its_own_times_is_awaited_like_others_that_take_turns():
    alone = make_plan("fig8", "pid", settings=["pid.active.times=[0.0]"])
    assert alone.simulator.controllers == ("pid",)
    assert make_plan("fig8", "pid").simulator.controllers == ()


@pytest.mark.slow
def test_a_fall_is_marked_and_verified(tmp_path):
    path = tmp_path / "fell.mcap"
    weak = ["pid.u_clamp_max=0.1", "pid.u_clamp_min=-0.1"]
    plan = make_plan("fig8", "pid", settings=weak, everywhere={"duration": 3.0})
    record_offline(plan, path)
    recording = Recording.open(path)
    run = RecordedRun(recording)
    table = RunTable.from_run(run)
    fell_ns = run.fall.stamp_ns
    assert fell_ns == table.t[np.abs(table.theta) > np.pi / 2][0] * 1e9
    assert verify(recording).exit_code == VERIFIED

    def unmarked(messages):
        messages[:] = [m for m in messages if m[0] != EVENTS or b"fell" not in m[2]]

    edited = RecordedRun(copied(path, tmp_path / "unmarked.mcap", unmarked, digests=NONE))
    assert edited.fall == run.fall, "it follows from the states"

    stopped = tmp_path / "stopped.mcap"
    record_offline(make_plan("fig8", "pid", settings=[*weak, "simulator.fall.stop=true"]), stopped)
    recording = Recording.open(stopped)
    assert recording.complete
    assert recording.end["reason"] == "the trunk has fallen"
    assert RunTable.from_run(RecordedRun(recording)).t[-1] == fell_ns / 1e9
    assert verify(recording).exit_code == VERIFIED


def swapped_by_hand(path, timeout=0.1):
    """Record a run whose first controller is made inactive 0.3 s before the second is made active."""
    plan = make_plan(
        "demo", "pid", everywhere={"duration": 1.0, "command_timeout": timeout}, swaps=[]
    )
    second = make_plan("demo", "lqr").controllers["lqr"]
    plan = replace(
        plan,
        controllers={**plan.controllers, "lqr": replace(second, autostart=False)},
        changes={
            "pid": (Change(200_000_000, None, Event.DEACTIVATED),),
            "lqr": (Change(500_000_000, None, Event.ACTIVATED),),
        },
    )
    record_offline(plan, path)
    return plan


def test_in_a_gap_between_two_turns_the_last_command_holds_until_it_is_too_old(tmp_path):
    path, again = tmp_path / "gap.mcap", tmp_path / "again.mcap"
    plan = swapped_by_hand(path)
    run = RecordedRun.open(path)
    verdict = verify(run.recording)
    assert verdict.exit_code == VERIFIED, verdict
    stamps, effort = (
        run.table("ground_truth/joint_states").stamp_ns,
        run.table("ground_truth/joint_states").values("effort")[:, 1],
    )
    commanded = run.table("effort_command").stamp_ns
    assert (
        np.setdiff1d(stamps, commanded).tolist()
        == stamps[(stamps > 200_000_000) & (stamps <= 500_000_000)].tolist()
    )
    # A true state's effort is the torque over the step before it.
    period = plan.simulator.period_ns
    last = effort[stamps == 200_000_000 + period]
    assert last != 0.0
    assert (effort[(stamps > 200_000_000) & (stamps <= 300_000_000 + period)] == last).all()
    assert (effort[(stamps > 300_000_000 + period) & (stamps <= 500_000_000 + period)] == 0.0).all()
    assert (effort[stamps > 500_000_000 + period] != 0.0).any()
    record_offline(run.plan(), again)
    assert diff(run, RecordedRun.open(again)).identical


def test_a_torque_that_nobody_commanded_diverges(tmp_path):
    path = tmp_path / "gap.mcap"
    swapped_by_hand(path, timeout=0.1375)
    before, after = (struct.pack("<d", timeout) for timeout in (0.1375, 0.2375))

    def other_timeout(messages):
        for message in messages:
            if message[0] == "/run/parameters":
                message[2] = message[2].replace(before, after)

    edited = copied(path, tmp_path / "edited.mcap", other_timeout, digests=ANEW)
    assert verify(edited).exit_code == DIVERGES
