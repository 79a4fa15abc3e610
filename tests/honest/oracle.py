"""What our own recorder and nodes write in two places agrees; a line for each contradiction.

No verdict depends on it: it guards the recorder, in every complete recording of an honest run.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from trunk_control.laws import law_named
from trunk_core import topics
from trunk_core.arrays import Integers
from trunk_core.errors import PlanError
from trunk_core.parameters.declarations import Value, declarations
from trunk_core.topics import ENDS, Event
from trunk_core.units import nanoseconds, seconds, step_count
from trunk_evidence.evidence import idle_ns
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.rerun import Rerun
from trunk_msgs_util.completeness import OF_STATES, OF_STATES_IN_REAL_TIME, Account
from trunk_recording.cdr import JointStateLayout
from trunk_recording.joint_table import QUANTITIES
from trunk_runs.nodes import CONTROLLERS, NODES
from trunk_runs.plan import check_rates
from trunk_sim.config import TrunkSimulator
from trunk_sim.links import Traffic

_MODES = {"real_time": False, "lockstep": True}  # is lockstep.enabled set?


def contradictions(run: RecordedRun) -> list[str]:
    """Return the contradictions in an honest run that is recorded as complete, with the plant in it."""
    rerun = Rerun(run)
    return [
        *_joints(run),
        *_start_and_end(run, rerun),
        *_account(run, rerun),
        *_order(run, rerun),
        *_falls(run, rerun),
        *_parameters(run),
        *_mode(run, rerun),
        *_pushes(run, rerun),
        *_branch(run, rerun),
        *_links(run, rerun),
    ]


def _joints(run: RecordedRun) -> Iterator[str]:
    """Yield a line where messages name other joints than the parameters, or hold other quantities."""
    joints = run.config("simulator").joints
    for node in ("disturbance", *run.judgeable):
        config = run.config(node) if node in run.parameters else None
        named = () if config is None else getattr(config, "joints", None) or (config.joint,)
        if not set(named) <= set(joints):
            yield f"{node}: {', '.join(named)}: the simulator's joints are {', '.join(joints)}"
    known = [name for name in run.controllers if name in CONTROLLERS and name in run.parameters]
    expected = {
        topics.GROUND_TRUTH: (joints, QUANTITIES),
        topics.JOINT_STATES: (joints, QUANTITIES),
        topics.PLANT_INPUTS: (topics.INPUT_NAMES, ("position", "velocity")),
        topics.DISTURBANCE: (joints, ("position", "effort")),
        topics.OPERATOR_PUSH: (joints, ("effort",)),
        topics.EFFORT_COMMAND: ((run.config(known[0]).joint,) if known else None, ("effort",)),
        **{
            topics.controller_state(name): (law_named(name).record_names, ("position",))
            for name in known
        },
    }
    for relative, (names, quantities) in expected.items():
        topic = run.recording.topics.get(run.topic(relative))
        if topic is None or names is None:
            continue
        position, velocity, effort = (len(names) * (q in quantities) for q in QUANTITIES)
        wanted = JointStateLayout(names, position, velocity, effort)
        for layout in topic.layouts:
            if run.is_ours(relative, layout.frame_id) and replace(layout, frame_id="") != wanted:
                yield f"{relative}: {_described(layout)}; by the parameters it must be {_described(wanted)}"
                break


def _described(layout: JointStateLayout) -> str:
    counts = (f"{getattr(layout, q)} of {q}" for q in QUANTITIES)
    return f"{', '.join(layout.name) or 'nothing'} with {', '.join(counts)}"


def _start_and_end(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield a line where the run does not begin and end once, as its parameters and its last state say."""
    config: TrunkSimulator = rerun.simulator.config
    events = rerun.simulator.events
    started = [event for event in events if event.message == Event.STARTED]
    if len(started) != 1:
        yield f"run/events: the simulator started {len(started)} times"
    elif started[0].values.get("rate") != str(config.update_rate):
        rate = started[0].values.get("rate")
        yield f"run/events: started at {rate} Hz, by the parameters {config.update_rate}"
    ends = [event for event in events if event.message in ENDS]
    if len(ends) != 1 or ends[0].message != Event.FINISHED:
        how = ", ".join(event.message for event in ends) or "not at all"
        yield f"marked as complete, but by run/events the run ended: {how}"
        return
    (end,), states = ends, len(rerun.stamps)
    if end.values.get("states") != str(states):
        yield f"{states} states, but the run had {end.values.get('states')} by run/events"
    reason = end.values.get("reason")
    if run.real_time:
        held = rerun.inputs.over(slice(0, max(states - 1, 0))).command_ns >= 0
        silent = int(np.argmax(held[::-1])) if held.any() else len(held)
        for name, count in (("commanded", int(held.sum())), ("silent", silent)):
            if end.values.get(name, str(count)) != str(count):  # not counted before: not asked for
                yield f"run/events: {name} = {end.values.get(name)}, by the plant's inputs {count}"
    last = int(rerun.stamps[-1]) if states else -1
    if end.stamp_ns != last:
        at = seconds(end.stamp_ns)
        yield f"run/events: finished at t = {at:g} s, the last state is at t = {seconds(last):g} s"
    fell = [event.stamp_ns for event in events if event.message == Event.FELL]
    by_fall = config.fall_stop and fell[-1:] == [last]
    wanted = step_count(config.duration, config.update_rate) + 1 if config.duration else None
    if not by_fall and wanted not in (None, states):
        duration = f"duration {config.duration:g} s at {config.update_rate:g} Hz has {wanted}"
        yield f"{states} states; {duration}"
    expected = "stopped on request" if wanted is None else "finished"
    expected = "the trunk has fallen" if by_fall else expected
    if reason != expected:
        yield f"run/events: ended as {reason!r}; by parameters and states it is {expected!r}"
    if config.fall_stop and any(stamp_ns < last for stamp_ns in fell):
        yield "run/events: fall.stop is set, but the run goes on after a fall"


def _account(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield a line where the recorder's own rule does not call the run whole, by what is in the file."""
    recording = run.recording
    whole, idle = [*OF_STATES_IN_REAL_TIME] if run.real_time else [*OF_STATES], 0
    if run.exact and not (run.external or rerun.inputs.recorded):
        idle = len(idle_ns(run))
        whole += [] if idle else [topics.EFFORT_COMMAND]
    account = Account(run.topic, whole, run.real_time)
    # A node may be called by the first part of a topic, such as plant.
    own = {run.topic(relative): relative for relative in OF_STATES_IN_REAL_TIME}
    for name, topic in recording.topics.items():
        relative = own.get(name) or run.relative(name)
        if not run.real_time or topic.type != topics.JOINT_STATE_TYPE:
            account.counts["", relative] += topic.count
            continue
        table = run.table(relative)
        for frame, count in zip(table.frames, np.bincount(table.frame).tolist(), strict=False):
            source = frame.partition(" ")[0]
            account.counts[source if "@" in source else "", relative] += count
    try:
        # Log times may be of a clock that was set back.
        for event in sorted(run.events, key=lambda event: event.stamp_ns):
            account.take_event(event)
    except ValueError as error:
        yield f"run/events: {error}"
        return
    for change in run.parameter_messages if run.mode != "offline" else ():  # there are no nodes
        account.take_parameters(change)
    complete, reason = account.verdict([run.relative(name) for name in recording.topics])
    marked = (recording.end or {}).get("reason")
    if not complete:
        yield f"marked as complete, but {reason}"
    elif reason != marked:
        yield f"run/events: the run ended as {reason!r}, the recorder noted {marked!r}"
    if idle and run.count(topics.EFFORT_COMMAND) != len(rerun.stamps) - idle:
        wanted = len(rerun.stamps) - idle
        yield f"{topics.EFFORT_COMMAND}: {run.count(topics.EFFORT_COMMAND)} messages for {wanted} states"


def _order(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield messages of one process that are doubled, out of order, or belong to no state."""
    period_ns = rerun.simulator.config.period_ns
    states = rerun.stamps
    for relative, nodes in (
        (topics.JOINT_STATES, ["simulator"]),
        (topics.DISTURBANCE, ["disturbance"]),
        (topics.PLANT_INPUTS, ["simulator"]),
        *((topics.EFFORT_COMMAND, [name]) for name in run.controllers),
        *((topics.controller_state(name), [name]) for name in run.controllers),
    ):
        if not run.count(relative):
            continue
        table = run.table(relative)
        for node in nodes:
            for process in run.processes(node) if node in run.parameters else ():
                stamps = process.stamps(table)
                if relative == topics.EFFORT_COMMAND and run.exact:
                    stamps = np.sort(stamps)  # a file does not keep the order between publishers
                falls = np.flatnonzero(np.diff(stamps) <= 0)
                if len(falls):
                    at = seconds(int(stamps[falls[0] + 1]))
                    yield f"{relative}: the message at t = {at:g} s is doubled or out of order"
                odd = _beyond(stamps, states, period_ns if relative == topics.DISTURBANCE else 0)
                if len(odd):
                    at = seconds(int(odd[0]))
                    yield f"{relative}: {len(odd)} messages for no state, the first at t = {at:g} s"
    if run.exact and run.count(topics.DISTURBANCE) and len(states):
        process = run.processes("disturbance")[0]
        last = int(states[-1]) + process.config.period_ns
        counted = run.mode == "offline" or bool(process.published)
        if counted and last not in run.table(topics.DISTURBANCE):
            yield f"{topics.DISTURBANCE}: none for the step after the last state"


def _beyond(stamps: Integers, known: Integers, ahead_ns: int) -> Integers:
    """Return the stamps that are not among those known, nor ``ahead_ns`` after the last of them."""
    if np.array_equal(stamps[: len(known)], known):  # an hour's would take much memory to sort
        stamps = stamps[len(known) :]
    odd = np.setdiff1d(stamps, known)
    return odd[odd != int(known.max(initial=-1)) + ahead_ns] if ahead_ns else odd


_OF_SIMULATOR = (
    *(Event.STARTED, Event.PAUSED, Event.RESUMED, Event.FELL, Event.CONNECTED, Event.DISCONNECTED),
    *(Event.PASSED_ON, Event.FINISHED, Event.STOPPED),
)


def _falls(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield falls whose angle is not that of their state, or whose limit is not the one in force."""
    truth = run.table(topics.GROUND_TRUTH)
    timeline = run.timeline("simulator")
    simulator = run.topic("simulator")
    for event in run.events:
        if event.message in _OF_SIMULATOR and event.node != simulator:
            yield f"run/events: {event.message!r} of {event.node}, which is not the simulator"
    for event in rerun.simulator.events:
        if event.message != Event.FELL or event.stamp_ns not in truth:
            continue
        at = f"run/events: fell at t = {seconds(event.stamp_ns):g} s"
        angle = truth.get(event.stamp_ns, "position")[-1]
        if event.values.get("angle") != str(angle):
            yield f"{at} with angle {event.values.get('angle')}, the state's is {angle}"
        timeline.advance(event.stamp_ns)
        limit = timeline.config.fall_angle
        if event.values.get("limit") != str(limit):
            yield f"{at} with limit {event.values.get('limit')}, by the parameters {limit}"


def _pushes(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield pushes that no simulator with this run's parameters takes."""
    prefix = f"{topics.OPERATOR_PUSH}: "
    pushes, limits = run.operated.pushes, rerun.simulator.config.operator_limits
    odd = np.setdiff1d([stamp_ns for stamp_ns, _ in pushes], rerun.stamps)
    if len(odd):
        yield f"{prefix}a message at t = {seconds(int(odd[0])):g} s, where there is no state"
    for stamp_ns, applied in pushes:
        if limits is not None and limits.clip(applied) != applied:
            at = seconds(stamp_ns)
            yield f"{prefix}what acts from t = {at:g} s on is beyond the operator's limits"


def _branch(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield that a branch of a real-time run has late steps where it is simulated."""
    if run.branch is None or not rerun.inputs.recorded:
        return
    since_ns = nanoseconds(run.branch.at)
    begin = int(np.searchsorted(rerun.stamps, since_ns))
    stamps, force = rerun.stamps[begin:-1], rerun.inputs.over(slice(begin, len(rerun.stamps) - 1))
    late = (force.command_ns != stamps) & ~np.isin(stamps, idle_ns(run))
    if run.count(topics.DISTURBANCE):
        late |= force.disturbance_ns != stamps
    if late.any():
        yield (
            f"{int(late.sum())} of {len(stamps)} steps from t = {seconds(since_ns):g} s on are late; "
            "a branch answers every state at once"
        )


def _links(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield counts of the links' messages that do not follow from their seed."""
    network = rerun.simulator.config.network
    counted = [event for event in rerun.simulator.events if event.message == Event.PASSED_ON]
    if len(counted) != (network is not None):
        yield f"run/events: {str(Event.PASSED_ON)!r} {len(counted)} times"
    elif network is not None and counted[0].values != Traffic(network).counts(len(rerun.stamps)):
        yield f"run/events: {str(Event.PASSED_ON)!r} is not what the links' seed gives"


def _parameters(run: RecordedRun) -> Iterator[str]:
    """Yield sets of parameters that are not whole, and changes that no node makes."""
    sets: dict[tuple[str, str], list[Mapping[str, Value]]] = {}
    for change in run.parameter_messages:
        node = run.relative(change.node)
        if node not in NODES:
            yield f"run/parameters: parameters of {change.node}, which is not one of our nodes"
            continue
        declared = declarations(NODES[node].config)
        if change.new:
            sets.setdefault((node, change.source), []).append(change.new)
        fixed = [name for name in change.changed if name in declared and declared[name].fixed]
        if fixed:
            yield f"run/parameters: {node} changes {', '.join(fixed)}, which is fixed at start"
    for (node, source), recorded in sets.items():
        # A node that learns from the states that it is in real time names no source before: each of its
        # processes has such a set, also one whose events are lost. In lock-step it was restarted.
        unnamed = run.real_time and not source
        alike = unnamed and all(values == recorded[0] for values in recorded)
        if len(recorded) > 1 and run.mode != "lockstep" and not alike:
            yield f"run/parameters: {len(recorded)} parameter sets of {node}"
    for event in run.events:
        node = run.relative(event.node)
        if node in NODES and node not in run.parameters:
            yield f"run/events: {event.message!r} of {node}, whose parameters are not recorded"
            return


def _mode(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
    """Yield differences of mode and controllers between the run's origin and its nodes."""
    if run.mode not in (*_MODES, "offline"):
        yield f"mode {run.mode!r}: the modes are real_time, lockstep and offline"
    configured = any(event.message == Event.CONFIGURED for event in run.events)
    if configured == (run.mode == "offline"):
        yield f"mode {run.mode}, but {'nodes' if configured else 'no nodes'} were configured"
    for node in ("simulator", *run.judgeable) if run.mode in _MODES else ():
        if run.config(node).lockstep != _MODES[run.mode]:
            yield f"mode {run.mode}, but {node} has lockstep.enabled = {run.config(node).lockstep}"
    if run.mode == "lockstep":
        try:
            check_rates(rerun.engine.plan)
        except PlanError as error:
            yield str(error)
    planned = run.recording.provenance.get("controller", "").split()
    if not set(run.controllers) <= {*planned, *(run.joined if planned else run.controllers)}:
        names = ", ".join(run.controllers)
        yield f"recorded with {names}, but the run's origin names {', '.join(planned)}"
    simulated = [run.table(t) for t in (topics.GROUND_TRUTH, topics.EFFORT_COMMAND)]
    sourced = any("@" in frame for table in simulated for frame in table.frames)
    if sourced != run.real_time:
        yield f"mode {run.mode}, but messages name {'their' if sourced else 'no'} sources"
