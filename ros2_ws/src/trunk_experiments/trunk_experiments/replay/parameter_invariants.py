"""What the parameters and the origin of a complete recording have to agree on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import Value, declarations

from ..errors import PlanError
from ..plans.nodes import NODES
from ..plans.plan import check_rates

if TYPE_CHECKING:
    from ..recorded.run import RecordedRun
    from .rerun import Rerun

_MODES = {"real_time": False, "lockstep": True}  # is lockstep.enabled set?


def parameter_contradictions(run: RecordedRun) -> Iterator[str]:
    """Yield sets of parameters that are not whole, and changes that no node makes."""
    sets: dict[tuple[str, str], list[Mapping[str, Value]]] = {}
    for change in run.recording.parameter_messages():
        node = run.recording.relative(change.node)
        if node not in NODES:
            yield f"run/parameters: parameters of {change.node}, which is not one of our nodes"
            continue
        declared = declarations(NODES[node].config)
        names = {*change.new, *change.changed}
        if unknown := names - set(declared):
            yield f"run/parameters: {node} has no parameters {', '.join(sorted(unknown))}"
        if change.new:
            sets.setdefault((node, change.source), []).append(change.new)
            if missing := set(declared) - set(change.new):
                yield f"run/parameters: the set of {node} lacks {', '.join(sorted(missing))}"
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
        node = run.recording.relative(event.node)
        if node in NODES and node not in run.parameters:
            yield f"run/events: {event.message!r} of {node}, whose parameters are not recorded"
            return


def mode_contradictions(run: RecordedRun, rerun: Rerun) -> Iterator[str]:
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
