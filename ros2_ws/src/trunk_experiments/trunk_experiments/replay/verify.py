"""Does a recording follow from itself? Structure first, then every command and state recomputed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trunk_msgs_util import topics
from trunk_msgs_util.parameters.declarations import ParameterError
from trunk_msgs_util.provenance import PACKAGE, packages_of_laws
from trunk_msgs_util.recording.reader import Recording, RecordingError
from trunk_msgs_util.units import seconds

from ..plans.nodes import CONTROLLERS, NODES, unknown_controllers
from ..recorded.run import RecordedRun
from ..recorded.turns import idle_ns
from .as_planned import not_as_planned
from .as_written import Survey, not_as_written, pictures
from .attributable import SHARED, robot_obstacles, shared_from_ns
from .consistency import contradictions, failures, killed, uncounted, without_a_count
from .driven import driven_controllers
from .gaps import gaps
from .missing import cut_off_ns, missed_from_ns, recorded_until_ns
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
    survey = surveyed(run)
    verdict = Verdict()
    verdict.obstacles += filter(None, [recording.unfinished, *recording.further_warnings])
    verdict.altered = recording.alterations()
    verdict.notes += [run.branch.describe()] if run.branch else []
    verdict.notes += _other_packages(run)
    uncovered = recording.undigested()
    if uncovered:
        verdict.obstacles.append(f"no digests of {', '.join(uncovered)}: an edit would not show")
    if not run.mode:
        verdict.obstacles.append("no provenance: the mode of the run is not known")
    if reason := run.cannot_be_recomputed():
        verdict.obstacles.append(reason)
        return verdict
    known = bool(run.controllers) and set(run.controllers) <= set(CONTROLLERS)
    if not known and not run.another_controller:
        unknown = unknown_controllers(run.controllers)
        verdict.obstacles.append(unknown or "no known controller's state is recorded")
        return verdict
    nodes = {"simulator", *(run.controllers if known else ())} | (
        {"disturbance"} if run.count(topics.DISTURBANCE) else set()
    )
    missing = nodes - set(run.parameters)
    no_plant = missing == {"simulator"} and not run.count(topics.GROUND_TRUTH)
    if missing and not no_plant:
        verdict.obstacles.append(f"no parameters recorded of {', '.join(sorted(missing))}")
        return verdict
    try:
        _judge_commands(run, verdict) if no_plant else _judge(run, verdict, survey)
    except ParameterError as error:
        verdict.obstacles.append(f"recorded parameters cannot be used: {error}")
    except RecordingError as error:
        verdict.obstacles.append(str(error).removeprefix(f"{recording.path}: "))
    verdict.notes += [
        f"{kind} is the node {recording.topic(kind)}" for kind in sorted(recording.renamed)
    ]
    return verdict


def _other_packages(run: RecordedRun) -> list[str]:
    """Return a line for each package of controllers that differs from the one that the run was recorded with.

    None where all controllers of the run are ours.
    """
    if all(name in NODES and NODES[name].package == "trunk_control" for name in run.controllers):
        return []
    told = {n: v for n, v in run.recording.provenance.items() if n.startswith(PACKAGE)}
    here = packages_of_laws() if told else {}
    return [
        f"{name}: recorded with {value}; here {here.get(name, 'it is not installed')}"
        for name, value in told.items()
        if here.get(name) != value
    ]


def surveyed(run: RecordedRun) -> Survey | None:
    """Read a sound recording once for digests, heads, layouts and tables; None if it is not sound.

    What this pass does not find is read when it is needed.
    """
    if run.recording.warnings:
        return None
    try:
        survey = Survey(run)
        run.fill_tables(survey.passing(run.recording.survey()))
    except (
        KeyError,
        ParameterError,
        RecordingError,
    ):  # code that needs it meets the error again, and reports it
        return None
    return survey


def _judge(run: RecordedRun, verdict: Verdict, survey: Survey | None) -> None:
    verdict.obstacles += gaps(run, run.config("simulator").period_ns)
    verdict.obstacles += failures(run.events, run.recording.topic("simulator"))
    until_ns = recorded_until_ns(run)
    if until_ns is not None:
        verdict.obstacles.append(
            f"the recorder was inactive from t = {seconds(until_ns):g} s: what follows is not judged"
        )
    cut_ns = cut_off_ns(run)
    if cut_ns is not None:
        until_ns = cut_ns - 1 if until_ns is None else min(until_ns, cut_ns - 1)
    missed_ns = missed_from_ns(run)
    if missed_ns is not None:
        until_ns = missed_ns - 1 if until_ns is None else min(until_ns, missed_ns - 1)
        verdict.obstacles.append(
            f"states or answers are missing from t = {seconds(missed_ns):g} s: what follows is not judged"
            + ("; start the recorder before the controller" if missed_ns == 0 else "")
        )
    shared_ns = shared_from_ns(run)
    if shared_ns is not None:
        verdict.obstacles.append(SHARED.format(seconds(shared_ns)))
        # The state at that time may have been answered by either.
        before_ns = shared_ns - run.config("simulator").period_ns
        until_ns = before_ns if until_ns is None else min(until_ns, before_ns)
    elif (run.recording.end or {}).get("complete") == "true" and cut_ns is not None:
        # A node was killed: its last messages may be missing.
        verdict.obstacles += uncounted(run) or without_a_count(killed(run))
    elif (run.recording.end or {}).get("complete") == "true":
        verdict.contradictions += contradictions(run)
        verdict.contradictions += not_as_written(run, survey)
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
        obstacles = robot_obstacles(run)
        verdict.obstacles += obstacles
        if not obstacles:
            shared_ns = shared_from_ns(run)
            if shared_ns is not None:
                verdict.obstacles.append(SHARED.format(seconds(shared_ns - run.begin_ns)))
                stamps = stamps[stamps < shared_ns]
            verdict.parts += _commands(run, None if shared_ns is None else shared_ns - 1)
            took = seconds(int(np.ptp(stamps))) if len(stamps) else 0.0
            verdict.judged = f"{len(stamps)} commands in {took:g} s to a plant that is not ours"
    verdict.obstacles.append("no simulator of ours: its states come from elsewhere")
    verdict.unjudged += ["the states, and whether all of them are recorded", *_unjudged(run)]


def _span(run: RecordedRun, until_ns: int | None) -> str:
    stamps = run.table(topics.GROUND_TRUTH).stamp_ns
    if until_ns is not None:
        stamps = stamps[stamps <= until_ns]
    if not len(stamps):
        return "no state"
    first, last = (seconds(int(stamps[i])) for i in (0, -1))
    mode = _MODES.get(run.mode, f"mode {run.mode or 'unknown'}")
    if run.branch is not None and not run.exact:
        mode += f" to t = {run.branch.at:g} s, then in lock-step"
    return f"t = {first:g} to {last:g} s, {len(stamps)} states, {mode}"


def _unjudged(run: RecordedRun) -> list[str]:
    """Return what no check of this run looks at."""
    found = [
        f"{name}: its parameters are recorded, but it gave no command"
        for name in sorted(set(run.parameters) & set(CONTROLLERS) - set(run.controllers))
    ]
    if not run.exact:
        found.append("when commands and disturbances arrived: the wall clock decides that")
    if pictures(run):
        found.append(f"the picture ({', '.join(topics.PICTURES)}): covered by digests alone")
    if run.another_controller:
        found.append(
            f"the commands and terms of {', '.join(run.controllers)}, another controller: "
            "the states follow from the commands"
        )
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
    if not run.another_controller and commands < (answered if run.exact else 1):
        found.append(f"commands: {commands} steps checked of {answered} states")
    found += [
        f"{part.name}: {part.steps} steps checked of {wanted} states"
        for part in parts
        if part.name == _PLANT and part.steps < wanted
    ]
    return found


def _commands(run: RecordedRun, until_ns: int | None) -> list[Part]:
    parts = {name: Part(f"commands of {name}") for name in run.controllers}
    nobodys = Part("commands without one active controller")
    for checked in replay_controllers(run, driven_controllers(run), until_ns):
        parts.get(checked.controller, nobodys).take(checked)
    return [*parts.values(), *([nobodys] if nobodys.steps else [])]


def _recomputed(run: RecordedRun, until_ns: int | None) -> list[Part]:
    found = [] if run.another_controller else _commands(run, until_ns)
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
