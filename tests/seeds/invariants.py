"""What holds after every run, whatever was done to it; each broken invariant is a line."""

from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Protocol

from trunk_core import topics
from trunk_core.errors import TrunkError
from trunk_core.topics import ENDS, Event
from trunk_evidence.judgement import UNJUDGED, VERIFIED, verdict_on
from trunk_evidence.recorded_run import RecordedRun, silence_of
from trunk_msgs_util.source import process_of
from trunk_recording.reader import Recording
from trunk_runs.offline_recording import record_offline

from .story import Story

# After these the run no longer follows its plan, or no longer has our nodes alone.
_OTHERWISE = {"gains", "reset", "deactivate", "activate", "cleanup", "second", "pause", "restart"}
# These are on record, or do not concern the recording: it is complete all the same.
_HARMLESS = {"gains", "reset", "pause", "clock", "late", "stall"}
_HARMLESS_STALL_S = 1.0  # nodes wait this long for each other at any time


class Ended(Protocol):
    """A process of the run."""

    @property
    def alive(self) -> bool: ...

    @property
    def exit_code(self) -> int | None:
        """None as well if it was killed."""

    @property
    def log(self) -> Sequence[str]:
        """What it has said."""


class Run(Protocol):
    """A story that has happened."""

    story: Story
    path: Path  # the recording
    folder: Path

    @property
    def processes(self) -> Mapping[str, Sequence[Ended]]: ...

    @property
    def complaints(self) -> str:
        """What all have written to stderr apart from their logs."""

    def published(self, topic: str, counted: Set[str] | None = None) -> tuple[int, int] | None:
        """Return how many messages there were at least and at most; None if nobody has counted."""


def broken(run: Run) -> Iterator[str]:
    """The invariants that a run, which is over, has broken."""
    yield from _processes(run)
    recorders = run.processes["recorder"]
    if not run.path.exists():
        if any(one.exit_code == 0 and one.log for one in recorders):  # else it was still loading
            yield "the recorder ended well, without a file"
        return
    try:
        recording = Recording.open(run.path)
    except TrunkError as error:
        if run.path.stat().st_size > 1000:  # else it was killed before anything was in it
            yield f"unreadable: {error}"
        return
    yield from _recorded(run, recording)


def _processes(run: Run) -> Iterator[str]:
    """Yield processes that hang, or end by a defect."""
    if "Traceback" in run.complaints:
        yield run.complaints.strip().splitlines()[-1]
    for name, some in run.processes.items():
        for process in some:
            if process.alive:
                yield f"{name} hangs"
            if process.exit_code not in (None, 0, 1, 2):
                yield f"{name}: exit code {process.exit_code}"
            for line in process.log:
                if "a callback raised" in line or "Traceback" in line:
                    yield f"{name}: {line.strip().splitlines()[-1]}"
            refused = "another /" in run.complaints  # before it had a logger
            if process.exit_code == 1 and not (process.log or refused):
                yield f"{name} failed without a word"


def _recorded(run: Run, recording: Recording) -> Iterator[str]:
    try:
        found = RecordedRun(recording)
        verdict = verdict_on(found)
    except TrunkError as error:
        yield f"no verdict: {error}"
        return
    if verdict.exit_code not in (VERIFIED, UNJUDGED):
        yield f"{verdict.word}: {'; '.join(verdict.reasons)[:300]}"
    if recording.end is not None and not recording.complete and not recording.end.get("reason"):
        yield "incomplete without a reason"
    if recording.end is None and all(one.exit_code == 0 for one in run.processes["recorder"]):
        yield "the recorder ended well, but its file has no end"
    yield from _stopped(run, found)
    if recording.complete:
        yield from _everything(run, found)
    kinds = {fault.kind for fault in run.story.faults}
    if recording.end is not None and not kinds & {"full", "restart"}:
        yield from _silent(run, found)
    if run.story.lockstep:
        yield from _names_nobody(found)
    if harmless(run.story):
        if not recording.complete:
            yield f"no harm was done to it, but it is incomplete: {recording.end}"
        elif verdict.exit_code != VERIFIED and not silence_of(
            found
        ):  # a stall may outlast a short run
            yield f"no harm was done to it, but it {verdict.word}: {'; '.join(verdict.reasons)[:300]}"
    if run.story.lockstep and not kinds & _OTHERWISE and found.count(topics.GROUND_TRUTH):
        yield from _as_offline(run, found)


def _names_nobody(found: RecordedRun) -> Iterator[str]:
    """Yield what names its process although time is exact, and nothing depends on who sent it."""
    if found.count(topics.PLANT_INPUTS):
        yield "in lock-step, but with rows of what acted"
    for topic in (topics.JOINT_STATES, topics.EFFORT_COMMAND, topics.DISTURBANCE):
        if named := {*found.table(topic).frames} - {""}:
            yield f"{topic}: in lock-step, but from {', '.join(sorted(named))}"
    if named := {message.source for message in found.events} - {""}:
        yield f"events: in lock-step, but from {', '.join(sorted(named))}"


def harmless(story: Story) -> bool:
    """Return True if nothing happens that keeps a run from its end."""
    if story.whole:
        return True
    stalls = [fault.value for fault in story.faults if fault.kind == "stall"]
    kinds = {fault.kind for fault in story.faults}
    return kinds <= _HARMLESS and sum(stalls) <= _HARMLESS_STALL_S


def _stopped(run: Run, found: RecordedRun) -> Iterator[str]:
    """Yield a simulator that was asked to stop and did not report it, where nothing else was done."""
    others = [f for f in run.story.faults if (f.kind, f.node) != ("stop", "simulator")]
    ended_well = all(one.exit_code == 0 for one in run.processes["simulator"])
    harmless = all(fault.kind in {"gains", "reset", "pause", "clock"} for fault in others)
    began = any(event.message == Event.STARTED for event in found.events)
    if harmless and ended_well and began and not any(e.message in ENDS for e in found.events):
        yield "the simulator did not say how the run ended"


def _silent(run: Run, found: RecordedRun) -> Iterator[str]:
    """Yield nodes whose parameters are on record without any event, although they ended in order."""
    heard = {event.node for event in found.events}
    shown = {change.node for change in found.parameter_messages}
    for name, some in run.processes.items():
        if f"/{name}" in shown - heard and all(one.exit_code is not None for one in some):
            yield f"{name}: its parameters are on record, but none of its events"


def _everything(run: Run, found: RecordedRun) -> Iterator[str]:
    """Yield topics of which a complete recording lacks something that was published."""
    ends = [event for event in found.events if event.message == Event.FINISHED]
    if not ends:
        yield "complete without an end"
    counted: set[str] | None = None
    second = any(fault.kind == "second" for fault in run.story.faults)
    if not run.story.lockstep:
        yield from _what_acted(found)
        # What acted on nothing, and nobody has counted, may be missing.
        said = [event.source for event in found.events if event.message == Event.PUBLISHED]
        counted = set(map(process_of, said))
    for topic in (topics.GROUND_TRUTH, topics.JOINT_STATES, topics.EFFORT_COMMAND):
        least, most = run.published(topic, counted) or (0, found.count(topic))
        if run.story.lockstep and topic == topics.EFFORT_COMMAND and second:
            # Of two that answer, the plant took one; what the other sent last may find no recorder.
            least = min(least, found.count(topics.GROUND_TRUTH))
        if not least <= found.count(topic) <= most:
            yield f"complete with {found.count(topic)} of {least} to {most} messages on {topic}"


def _what_acted(found: RecordedRun) -> Iterator[str]:
    """Yield states of a complete recording of which it does not have what acted on the plant."""
    rows, states = found.table(topics.PLANT_INPUTS), found.table(topics.GROUND_TRUTH)
    if rows.stamp_ns.tolist() != states.stamp_ns.tolist():
        yield f"complete with {len(rows)} rows of what acted for {len(states)} states"
    for topic, column, quantity in (
        (topics.EFFORT_COMMAND, 0, "effort"),
        (topics.DISTURBANCE, 1, "effort"),
    ):
        table = found.table(topic)
        values = table.values(quantity)[:, 0] if len(table) else ()
        there = {
            (stamp, table.frames[frame]): value
            for stamp, frame, value in zip(
                table.stamp_ns.tolist(), table.frame, values, strict=True
            )
        }
        for row, stamp in enumerate(rows.stamp_ns.tolist()):
            age = rows.values("velocity")[row, column]
            source = rows.frames[rows.frame[row]].split()[1 + (column > 0)]
            named = stamp - int(age), "" if source == "-" else source
            value = rows.values("position")[row, column]
            if age < 0.0:
                if value or source != "-":
                    yield f"{topic}: nothing acted at {stamp} ns, but {value:g} of {source}"
            elif there.get(named) != value:
                yield f"{topic}: {named} acted, but is not on record with {value:g}"


def _as_offline(run: Run, found: RecordedRun) -> Iterator[str]:
    """Yield where a run in lock-step differs from the offline run, as far as it goes."""
    path = run.folder / f"{run.story.controller}_{run.story.duration}.mcap"
    if not path.exists():
        record_offline(run.story.plan(), path)
    offline = RecordedRun.open(path)
    for topic in (
        topics.GROUND_TRUTH,
        topics.JOINT_STATES,
        topics.EFFORT_COMMAND,
        topics.DISTURBANCE,
    ):
        ours, theirs = found.table(topic), offline.table(topic)
        rows = theirs.rows_of(ours.stamp_ns)
        if (rows < 0).any():
            yield f"{topic}: a stamp that the offline run does not have"
            continue
        for quantity in ("position", "velocity", "effort"):
            if ours.values(quantity).tobytes() != theirs.values(quantity)[rows].tobytes():
                yield f"{topic}: {quantity} is not that of the offline run"
