"""Whether a run's end, rates, sets of parameters and origin agree with its nodes' parameters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

from trunk_msgs_util import topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import declarations
from trunk_msgs_util.units import seconds, step_count
from trunk_sim.hardware_parameters import LINK

from ..plans.nodes import CONTROLLERS, NODES
from .as_written import pictures

if TYPE_CHECKING:
    from trunk_sim.config import SimulatorConfig

    from ..recorded.run import RecordedRun

# Groups of parameters that recordings of earlier versions lack; such runs are judged with the defaults.
_LATER: dict[str, tuple[tuple[str, ...], ...]] = {
    "recorder": (("markers",),),
    "simulator": (
        ("path.cosines", "path.sines"),
        (
            *("actuator.time_constant", "actuator.rate_limit", "actuator.dead_band"),
            *("actuator.resolution", "actuator.bias"),
            *("actuator.coulomb_friction", "actuator.viscous_friction"),
            *("sensor.position_resolution", "sensor.velocity_resolution"),
            *("sensor.position_limit", "sensor.velocity_limit"),
        ),
        (
            "sensor.dropout",
            *(f"link.{way}.{name}" for way in ("state", "command") for name in LINK),
            *("link.command.missing", "link.seed"),
        ),
        ("operator.force", "operator.torque", "operator.timeout"),
    ),
    "computed_torque": (("model.path_cosines", "model.path_sines"),),
    "disturbance": (
        (
            *("pulse.random_count", "pulse.random_from", "pulse.random_until"),
            *("pulse.random_seed", "table.channel", "table.times", "table.values"),
            "table.interpolation",
        ),
    ),
}


def not_as_planned(run: RecordedRun) -> list[str]:
    """Return what does not agree, a line each. Raises ParameterError for wrong parameters."""
    return [*_end(run), *_rates(run), *_parameters(run), *_picture(run), *_origin(run)]


def _end(run: RecordedRun) -> Iterator[str]:
    """Yield where the run's end does not follow from its parameters and its last state."""
    truth = run.table(topics.GROUND_TRUTH)
    config: SimulatorConfig = run.config("simulator")
    name = run.recording.topic("simulator")
    ends = [e for e in run.events if e.node == name and e.message == Event.FINISHED]
    if not ends or not len(truth):
        return
    last = int(truth.stamp_ns.max())
    if ends[0].stamp_ns != last:
        at = seconds(ends[0].stamp_ns)
        yield f"run/events: finished at t = {at:g} s, the last state is at t = {seconds(last):g} s"
    reason = ends[0].values.get("reason")
    wanted = step_count(config.duration, config.update_rate) if config.duration else None
    fell = [e.stamp_ns for e in run.events if e.node == name and e.message == Event.FELL]
    if any(after <= before for before, after in pairwise(fell)):
        yield "run/events: two falls in one state, or out of order"
    by_fall = config.fall_stop and bool(fell) and fell[-1] == last
    expected = (
        "the trunk has fallen"
        if by_fall
        else "finished"
        if wanted is not None
        else "stopped on request"
    )
    if reason != expected:
        yield f"run/events: ended as {reason!r}; by parameters and states it is {expected!r}"
    if not by_fall and wanted is not None and len(truth) != wanted + 1:
        yield (
            f"{len(truth)} states; duration {config.duration:g} s at {config.update_rate:g} Hz "
            f"has {wanted + 1}"
        )
    if config.fall_stop and any(stamp < last for stamp in fell):
        yield "run/events: fall.stop is set, but the run goes on after a fall"


def _rates(run: RecordedRun) -> Iterator[str]:
    """Yield controllers that a plant in lock-step would have refused."""
    period_ns = run.config("simulator").period_ns
    for name in run.controllers if run.mode == "lockstep" else ():
        ratio = run.config(name).period_ns / period_ns
        if ratio <= 0.999 or abs(ratio - round(ratio)) >= 1e-3:
            yield f"{name}: update_rate is not an integer divisor of the simulator's, in lock-step"


def _picture(run: RecordedRun) -> Iterator[str]:
    """Yield a picture that the recorder was not asked for, or a missing one that it was asked for."""
    asked = run.parameters.get("recorder", {}).get("markers", False)
    if run.mode != "offline" and asked != bool(pictures(run)):
        what = (
            "a picture, but recorder.markers is false"
            if pictures(run)
            else "no picture, but it is true"
        )
        yield f"run/parameters: {what}"


def _parameters(run: RecordedRun) -> Iterator[str]:
    """Yield sets of parameters that are not whole, doubled, late, or changed where they are fixed."""
    sets: Counter[str] = Counter()
    for change in run.recording.parameter_messages():
        node = run.recording.relative(change.node)
        if node not in NODES:
            yield f"run/parameters: parameters of {change.node}, which is not one of our nodes"
            continue
        declared = declarations(NODES[node].config)
        if change.new:
            sets[node] += 1
            groups = _LATER.get(node, ())
            lacking = {n for some in groups if not set(some) & set(change.new) for n in some}
            whole = tuple(name for name in declared if name not in lacking)
            if tuple(change.new) != whole:
                odd = ", ".join(sorted(set(whole) ^ set(change.new))) or "their order"
                yield f"run/parameters: the parameter set of {node} is not that of this version: {odd}"
            if change.stamp_ns:
                yield f"run/parameters: the parameter set of {node} is stamped {change.stamp_ns} ns, not 0"
        if bool(change.new) == bool(change.changed):
            yield f"run/parameters: a message of {node} that is not either a first set or a change"
        fixed = [name for name in change.changed if name in declared and declared[name].fixed]
        if fixed:
            yield f"run/parameters: {node} changes {', '.join(fixed)}, which is fixed at start"
    for node, count in sets.items():
        if count > 1:
            yield f"run/parameters: {count} parameter sets of {node}: it was restarted"


def _origin(run: RecordedRun) -> Iterator[str]:
    """Yield where the run's origin does not match the recorder's parameters, or what ran."""
    origin = run.recording.provenance
    if run.mode == "offline":
        known = (name for name in run.parameters if name in CONTROLLERS)
        ran = " ".join(run.controllers if run.another_controller else known)
        expected = {"controller": ran, "rmw": "none"}
    elif "recorder" in run.parameters:
        recorder = run.config("recorder")
        expected = {
            "scenario": recorder.scenario,
            "controller": " ".join(recorder.controllers),
            "mode": recorder.mode,
        }
    else:
        yield "no parameters of the recorder: a graph's recorder writes its own"
        return
    for key, value in expected.items():
        if origin.get(key) != value:
            yield f"origin: {key} is {origin.get(key)!r}, by the parameters {value!r}"
    name = run.recording.topic("recorder")
    for process in (
        e.values["process"] for e in run.events if e.node == name and "process" in e.values
    ):
        if process != origin.get("process"):
            yield f"origin: process {origin.get('process')!r}, the recorder is {process!r}"
    library = run.recording.library.rsplit("/", 1)[-1]
    if origin.get("mcap") != library:
        yield f"origin: mcap {origin.get('mcap')!r}, the file's header has {library!r}"
