"""A run in the real graph: start the node set, watch it, stop it in order, leave nothing behind."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from trunk_core.deadline import Deadline, patience
from trunk_core.errors import RunError, StoppedError
from trunk_core.topics import ENDS, RUN_EVENTS, Event
from trunk_msgs_util.node import middleware
from trunk_msgs_util.node.early_signals import Interrupt
from trunk_recording.reader import Recording, RecordingError
from trunk_recording.schemas import RunEvent

from .nodes import NODES
from .plan import RunPlan
from .processes import ALL_S, NodeProcess, find_executable, stop
from .run_files import RunFiles

if TYPE_CHECKING:
    from .monitor_node import Monitor

START_TIMEOUT_S = 30.0
EXIT_FAILED = 1  # of a node that has said why
SILENCE_S = 5.0  # of a simulator that diagnoses itself every second
COMPOSED = "composed"
_LAST = (COMPOSED, "recorder")  # to be stopped: it has to record the others' last messages
_ENDS_FIRST_S = 1.5  # before all others are told, too: docs/faults.md promises 10 s for everything
_WAITING = "{} not active: with autostart false, configure and activate it (ros2 lifecycle set …)"


def run_graph(
    plan: RunPlan,
    files: RunFiles,
    progress: Callable[[float], None],
    order: Sequence[str] | None = None,
    composed: bool = False,
    over: Callable[[], bool] = lambda: False,
    note: Callable[[str], None] = lambda line: None,
) -> Recording:
    """Run the plan's nodes, as processes or ``composed`` in one, until the simulator is done.

    ``progress`` is called with simulated seconds. ``order``: the nodes' names in the order of their
    start (it makes no difference to a lock-step run). ``over`` is polled: True ends the run. A run
    without an end is then whole, as it is after SIGINT. ``note`` is called with what a user should know at
    once. Return the recording, checked to be this
    run's own. Raises RunError naming the node that ended the run and why; by then every process has been
    stopped and the recording finished.
    """
    lines: set[str] = set()

    def tell(line: str) -> None:
        if line not in lines:
            lines.add(line)
            note(line)

    middleware.prepare()
    files.logs.mkdir(parents=True, exist_ok=True)
    plan = files.record(plan)
    running: dict[str, NodeProcess] = {}
    names = list(plan.configs)
    interrupt = Interrupt()
    try:
        for process in [COMPOSED] if composed else order or names:
            package = "trunk_experiments" if composed else NODES[process].package
            command = [str(find_executable(package, process)), *(names if composed else [])]
            log = files.log(process)
            running[process] = NodeProcess.start(process, command, files.parameters, log)
        from .monitor_node import Monitor  # here: no threads while processes start

        with Monitor() as monitor:
            heard, stopped_by = _watch(plan, running, monitor, progress, interrupt, over, tell)
    finally:
        killed = _stop_all(running)
        if line := files.describe():
            tell(f"trunk: warning: {line}")
        interrupt.restore()
    recorder = running.get(COMPOSED) or running["recorder"]
    if not heard:
        simulator = running.get(COMPOSED) or running["simulator"]
        _read_end(files.recording, simulator, recorder, stopped_by)
    _check_recorder(recorder, killed, files.recording)
    recording = _own_recording(files.recording, recorder)
    events: Sequence[RunEvent] = ()
    with suppress(RecordingError):  # who reads it is told why
        events = recording.events(f"{plan.namespace}/{RUN_EVENTS}")
    for event in events:  # of a short run some may not have been heard
        if line := _note_of(event.node, event.message, event.values):
            tell(line)
    return recording


def _watch(
    plan: RunPlan,
    running: dict[str, NodeProcess],
    monitor: Monitor,
    progress: Callable[[float], None],
    interrupt: Interrupt,
    over: Callable[[], bool],
    note: Callable[[str], None],
) -> tuple[bool, str]:
    """Return whether it was heard that the run has finished, and who stopped it; empty: nobody."""
    starting, silence, signs = Deadline(START_TIMEOUT_S), Deadline(SILENCE_S), 0
    own = {name: (running.get(COMPOSED) or running[name]).identity for name in plan.configs}
    simulator = running.get(COMPOSED) or running["simulator"]
    while simulator.exit_code is None:
        monitor.spin(0.05)
        _pass_on(monitor, note)
        if monitor.finished:
            break  # who stops or dies now does not change the run
        ends = interrupt.name or ("request" if over() else "")
        if ends and simulator.exit_code is None:
            if not plan.simulator.duration:
                note(f"stopped by {ends}: ending the nodes, the recorder last")
                _end_first(simulator, monitor)
                return False, ends
            begun = "; the recording holds the run up to here"
            raise StoppedError(ends, begun if monitor.started else " before the run began")
        _check_alive(running, simulator, monitor)
        if monitor.signs_of_life != signs or not monitor.started:
            signs = monitor.signs_of_life
            silence.restart()
        if silence.passed:
            simulator.signal(signal.SIGKILL)  # it would not hear anything else
            raise RunError(
                f"the run ended because {simulator.name} has sent nothing for {silence.limit_s:g} s"
            )
        if doubled := monitor.doubled(own):
            raise RunError(
                f"another {doubled[0]} is running in this ROS domain: stop it, "
                "or set ROS_DOMAIN_ID to another number"
            )
        if plan.external is not None and monitor.waits_for.seen_instead:
            starting.restart()  # everything of ours is there
        if not monitor.started and starting.passed:
            raise RunError(
                f"the run did not start within {starting.limit_s:g} s: "
                f"{_silent(plan, monitor.ready)}"
            )
        progress(monitor.time)
    _hear_last_words(monitor)
    _pass_on(monitor, note)
    if monitor.failure:
        raise RunError(monitor.failure)
    return monitor.finished, ""


def _pass_on(monitor: Monitor, note: Callable[[str], None]) -> None:
    """Tell the user what is new, and once a controller is overdue, what the simulator sees instead."""
    if monitor.waits_for.seen_instead:
        line = f"still waiting for {monitor.waits_for}"
        if line != monitor.overdue:
            monitor.overdue = line
            note(line)
    for event in monitor.events:
        if line := _note_of(*event):
            note(line)
    monitor.events.clear()


def _note_of(node: str, message: str, values: Mapping[str, str]) -> str:
    """Return the line that tells a user at once of an event; empty for most."""
    if message in (Event.CONNECTED, Event.DISCONNECTED):
        who = values.get("node") or "a participant without a ROS node"
        return f"{message}: {who} ({values.get('middleware', '?')})"
    if message == Event.REFUSED and "what" in values:
        return f"{node.rpartition('/')[2]}: {values['what']}: {values.get('why', '')}"
    return ""


def _silent(plan: RunPlan, ready: set[str]) -> str:
    """Return which nodes are not ready, and why if that is known."""
    starts = any(controller.autostart for controller in plan.controllers.values())
    waiting = [
        name
        for name, node in plan.configs.items()
        if not (node.autostart or name in ready or (starts and name in plan.controllers))
    ]
    if waiting:
        return _WAITING.format(", ".join(waiting))
    silent = [name for name in plan.configs if name not in {*ready, "simulator"}]
    return f"{', '.join(silent) or 'simulator'} not ready"


def _end_first(simulator: NodeProcess, monitor: Monitor) -> None:
    """Let the simulator end while all others are there, so that its last state is answered and recorded."""
    simulator.signal(signal.SIGINT)
    deadline = Deadline(_ENDS_FIRST_S)
    while simulator.exit_code is None and not deadline.passed:
        monitor.spin(0.05)


def _hear_last_words(monitor: Monitor) -> None:
    deadline = Deadline(0.5)
    while not (monitor.failure or monitor.finished or deadline.passed):
        monitor.spin(0.05)


def _check_alive(running: dict[str, NodeProcess], simulator: NodeProcess, monitor: Monitor) -> None:
    dead = [p for p in running.values() if p is not simulator and p.exit_code is not None]
    if not dead:
        return
    _hear_last_words(monitor)  # it may have said why, or the run may just have ended
    if monitor.finished or simulator.exit_code is not None:
        return
    if dead[0].exit_code == EXIT_FAILED and monitor.failure:
        raise RunError(monitor.failure)
    raise RunError(f"the run ended because {dead[0].describe_end()}")


def _stop_all(running: dict[str, NodeProcess]) -> set[str]:
    """Stop all at once, but the recorder last. Return the names of those that had to be killed."""
    first = [process for name, process in running.items() if name not in _LAST]
    last = [process for name, process in running.items() if name in _LAST]
    return {process.name for process in stop(first, last)}


def _check_recorder(process: NodeProcess, killed: set[str], file: Path) -> None:
    """Report a run that was whole but whose recording has no end; one with an end says what it lacks."""
    if process.name in killed:
        raise RunError(
            f"the recording is not whole: {process.name} did not end within {ALL_S * patience():g} s "
            "and was killed"
        )
    if process.exit_code != 0 and not _has_end(file):
        raise RunError(f"the recording is not whole: {process.describe_end()}")


def _has_end(file: Path) -> bool:
    with suppress(RecordingError):
        return Recording.open_by_summary(file).end is not None
    return False


def _own_recording(file: Path, recorder: NodeProcess) -> Recording:
    """Open the recording. Raises RunError where this run's recorder has not written it."""
    recording = Recording.open(file)
    if recording.provenance.get("process", "") != recorder.identity:
        raise RunError(f"{file}: another file has replaced this run's recording")
    return recording


def _read_end(file: Path, simulator: NodeProcess, recorder: NodeProcess, stopped_by: str) -> None:
    """Take from the recording how the simulator ended the run. Raises RunError where too early.

    A process that was held up may not have heard of the start: the recording has it.
    """
    events: list[RunEvent] = []
    with suppress(RecordingError):  # there may be none yet
        events = _own_recording(file, recorder).events(f"/{RUN_EVENTS}")
    reports = [event for event in events if event.node == "/simulator"]
    ends = [event for event in reports if event.message in ENDS]
    if not ends:
        if stopped_by and all(event.message != Event.STARTED for event in reports):
            raise StoppedError(stopped_by, " before the run began")
        raise RunError(f"the run ended because {simulator.describe_end()}")
    if ends[-1].message != Event.FINISHED:
        raise RunError(f"simulator: {ends[-1].values.get('reason', ends[-1].message)}")
