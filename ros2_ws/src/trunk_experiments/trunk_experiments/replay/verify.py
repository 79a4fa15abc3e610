"""Does a recording follow from itself? Structure first, then every command and state recomputed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trunk_msgs_util import provenance, topics
from trunk_msgs_util.events import Event
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS
from ..recorded.run import RecordedRun
from ..recorded.turns import idle_ns
from .as_planned import not_as_planned
from .as_written import not_as_written
from .attributable import shared_from_ns
from .consistency import contradictions, failures, uncounted
from .gaps import absent_steps, gaps
from .real_time import replay_torques
from .replay import Checked, replay_controllers, replay_disturbance
from .replay_plant import PlantReplay
from .told import untellable
from .verdict import DIVERGES, ORIGIN, UNJUDGED, VERIFIED, Part, Verdict, describe

__all__ = [
    "DIVERGES",
    "UNJUDGED",
    "VERIFIED",
    "Part",
    "Verdict",
    "describe",
    "verdict_on",
    "verify",
]

_PLANT = "states of the plant"
_MODES = {"real_time": "in real time", "lockstep": "in lock-step", "offline": "offline"}


def verify(recording: Recording) -> Verdict:
    """Return the verdict on a recording; damage and gaps are obstacles, never ignored."""
    return verdict_on(RecordedRun(recording))


def verdict_on(run: RecordedRun) -> Verdict:
    """Return the verdict on a recorded run, as `verify` does."""
    recording = run.recording
    verdict = Verdict()
    verdict.obstacles += recording.warnings
    verdict.altered = recording.alterations()
    uncovered = recording.undigested()
    if uncovered:
        verdict.obstacles.append(f"no digests of {', '.join(uncovered)}: an edit would not show")
    if recording.end is None:
        verdict.obstacles.append("no end marker: the recorder did not finish this file")
    if not run.mode:
        verdict.obstacles.append("no provenance: the mode of the run is not known")
    if not run.controllers or not set(run.controllers) <= set(CONTROLLERS):
        found = ", ".join(run.controllers) or "none"
        verdict.obstacles.append(f"no known controller's state is recorded (found: {found})")
        return verdict
    nodes = {*run.controllers, "simulator"} | (
        {"disturbance"} if run.count(topics.DISTURBANCE) else set()
    )
    missing = nodes - set(run.parameters)
    no_plant = missing == {"simulator"} and not run.count(topics.GROUND_TRUTH)
    if missing and not no_plant:
        verdict.obstacles.append(f"no parameters recorded of {', '.join(sorted(missing))}")
        return verdict
    try:
        (_judge_commands if no_plant else _judge)(run, verdict)
    except ParameterError as error:
        verdict.obstacles.append(f"recorded parameters cannot be used: {error}")
    except RecordingError as error:
        verdict.obstacles.append(str(error).removeprefix(f"{recording.path}: "))
    verdict.notes += [
        f"{kind} is the node {recording.topic(kind)}" for kind in sorted(recording.renamed)
    ]
    verdict.notes += _platform(recording)
    return verdict


_SHARED = "two simulators or controllers, or one that was started anew: what follows t = {:g} s is not judged"


def _judge(run: RecordedRun, verdict: Verdict) -> None:
    verdict.obstacles += gaps(run, run.config("simulator").period_ns)
    verdict.obstacles += failures(run.events, run.recording.topic("simulator"))
    until_ns = _recorded_until_ns(run)
    if until_ns is not None:
        verdict.obstacles.append(
            f"the recorder was inactive from t = {seconds(until_ns):g} s: what follows is not judged"
        )
    missed_ns = _missed_from_ns(run)
    if missed_ns is not None:
        until_ns = missed_ns - 1 if until_ns is None else min(until_ns, missed_ns - 1)
        verdict.obstacles.append(
            f"states are missing from t = {seconds(missed_ns):g} s: what follows is not judged"
            + ("; start the recorder before the controller" if missed_ns == 0 else "")
        )
    shared_ns = shared_from_ns(run)
    if shared_ns is not None:
        verdict.obstacles.append(_SHARED.format(seconds(shared_ns)))
        # The state at that time may have been answered by either.
        before_ns = shared_ns - run.config("simulator").period_ns
        until_ns = before_ns if until_ns is None else min(until_ns, before_ns)
    elif (run.recording.end or {}).get("complete") == "true":
        verdict.contradictions += contradictions(run)
        verdict.contradictions += not_as_written(run)
        verdict.contradictions += untellable(run)
        verdict.contradictions += not_as_planned(run)
        verdict.obstacles += uncounted(run)
    verdict.parts += _recomputed(run, until_ns)
    verdict.judged = _span(run, until_ns)
    verdict.obstacles += _too_few(run, verdict.parts, until_ns)
    verdict.unjudged += _unjudged(run)


def _judge_commands(run: RecordedRun, verdict: Verdict) -> None:
    """Judge the commands to a plant that is not ours, from the states that it published."""
    stamps = run.table(topics.EFFORT_COMMAND).stamp_ns
    if len(stamps):
        obstacles = _of_another_robot(run)
        verdict.obstacles += obstacles
        if not obstacles:
            shared_ns = shared_from_ns(run)
            if shared_ns is not None:
                verdict.obstacles.append(_SHARED.format(seconds(shared_ns - run.begin_ns)))
                stamps = stamps[stamps < shared_ns]
            verdict.parts += _commands(run, None if shared_ns is None else shared_ns - 1)
            took = seconds(int(np.ptp(stamps))) if len(stamps) else 0.0
            verdict.judged = f"{len(stamps)} commands in {took:g} s to a plant that is not ours"
    verdict.obstacles.append("no simulator of ours: its states come from elsewhere")
    verdict.unjudged += ["the states, and whether all of them are recorded", *_unjudged(run)]


def _of_another_robot(run: RecordedRun) -> list[str]:
    """Return why our commands to a robot cannot be recomputed."""
    found = []
    states = run.table(topics.JOINT_STATES).stamp_ns
    unknown = np.setdiff1d(run.table(topics.EFFORT_COMMAND).stamp_ns, states)
    if len(unknown):
        found.append(
            f"{len(unknown)} commands answer states that are not recorded: what followed from them is "
            "not known; start the recorder before the controller"
        )
    joints = sorted({run.config(name).joint for name in run.judgeable})
    if len(joints) > 1:
        found.append(f"our controllers command several joints: {', '.join(joints)}")
    if states.min(initial=0) < 0:
        found.append("states before t = 0: their order is not known")
    node, inactive = run.recording.topic("recorder"), False
    for event in run.events:
        inactive |= event.node == node and event.message == Event.DEACTIVATED
        if inactive and event.node == node and event.message == Event.ACTIVATED:
            found.append("the recorder was inactive for a while: what it missed is not known")
            break
    return found


def _span(run: RecordedRun, until_ns: int | None) -> str:
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    if until_ns is not None:
        stamps = stamps[stamps <= until_ns]
    if not len(stamps):
        return "no state"
    first, last = (seconds(int(stamps[i])) for i in (0, -1))
    mode = _MODES.get(run.mode, f"mode {run.mode or 'unknown'}")
    return f"t = {first:g} to {last:g} s, {len(stamps)} states, {mode}"


def _unjudged(run: RecordedRun) -> list[str]:
    """Return what no check of this run looks at."""
    found = [
        f"{name}: its parameters are recorded, but it gave no command"
        for name in sorted(set(run.parameters) & set(CONTROLLERS) - set(run.controllers))
    ]
    if not run.exact:
        found.append("when commands and disturbances arrived: the wall clock decides it")
    found.append(ORIGIN)
    return found


def _too_few(run: RecordedRun, parts: list[Part], until_ns: int | None) -> list[str]:
    """Return what was recomputed for fewer steps than the run has."""
    if until_ns is not None:
        return []
    wanted = run.count(topics.GROUND_TRUTH)
    commands = sum(part.steps for part in parts if part.name.startswith("commands"))
    found = [f"{part.name}: nothing was checked" for part in parts if not part.steps]
    answered = wanted - len(idle_ns(run))
    if commands < (answered if run.exact else 1):
        found.append(f"commands: {commands} steps checked of {answered} states")
    found += [
        f"{part.name}: {part.steps} steps checked of {wanted} states"
        for part in parts
        if part.name == _PLANT and part.steps < wanted
    ]
    return found


def _missed_from_ns(run: RecordedRun) -> int | None:
    """Return the first step missed by a recorder that came late or could not keep up; None without any.

    What follows depends on it: the plant's state, a law's memory. In a file that says to be complete a gap is
    a contradiction.
    """
    if (run.recording.end or {}).get("complete") == "true":
        return None
    period_ns = run.config("simulator").period_ns
    gaps_of = (
        absent_steps(run.table(relative).stamp_ns, period_ns)
        for relative in (topics.GROUND_TRUTH, topics.JOINT_STATES)
    )
    return min((first for count, first in gaps_of if count), default=None)


def _recorded_until_ns(run: RecordedRun) -> int | None:
    """Return until when everything is recorded; None if the recorder never missed a part of the run.

    When it became inactive, messages of any topic were still queued, and were dropped: the first step of
    which a part is missing ends it, and the last one may have been answered in part.
    """
    node = run.recording.topic("recorder")
    turns = [e for e in run.events if e.node == node and e.message == Event.DEACTIVATED]
    commands = run.table(topics.EFFORT_COMMAND).stamp_ns
    if not turns or not len(commands) or turns[0].stamp_ns >= commands.max():
        return None
    terms = np.concatenate(
        [run.table(topics.controller_state(n)).stamp_ns for n in run.controllers]
    )
    states = [run.table(t).stamp_ns for t in (topics.GROUND_TRUTH, topics.JOINT_STATES)]
    period_ns = run.config("simulator").period_ns
    firsts = [absent_steps(stamps, period_ns)[1] for stamps in states]
    if not run.exact:  # every command is an update, and has its terms
        firsts += np.setxor1d(commands, terms)[:1].tolist()
    return min(*firsts, int(commands[commands <= turns[0].stamp_ns].max(initial=0))) - 1


def _commands(run: RecordedRun, until_ns: int | None) -> list[Part]:
    parts = {name: Part(f"commands of {name}") for name in run.controllers}
    nobodys = Part("commands without one active controller")
    for checked in replay_controllers(run, run.controllers, until_ns):
        parts.get(checked.controller, nobodys).take(checked)
    return [*parts.values(), *([nobodys] if nobodys.steps else [])]


def _recomputed(run: RecordedRun, until_ns: int | None) -> list[Part]:
    found = _commands(run, until_ns)
    replays: dict[str, Iterable[Checked]] = {}
    if run.count(topics.DISTURBANCE):
        replays["disturbances"] = replay_disturbance(run, until_ns)
    if not run.exact:
        replays["torques in force"] = replay_torques(run, until_ns)
    replays[_PLANT] = PlantReplay(run, until_ns)
    for name, replay in replays.items():
        part = Part(name)
        for checked in replay:
            part.take(checked)
        found.append(part)
    return found


def _platform(recording: Recording) -> list[str]:
    return [
        f"recorded with {key} {recording.provenance[key]}, here {here}: last bits may differ"
        for key, here in provenance.arithmetic().items()
        if key in recording.provenance and recording.provenance[key] != here
    ]
