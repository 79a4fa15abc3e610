"""What `trunk verify` lets pass although the digests were written anew, and why.

A pattern matches an edit's whole name: the base, the kind, what is edited. An edit that is refused must not
be in here: the list says what is let pass, no more.
"""

from __future__ import annotations

import re

_ANY = "(offline|lockstep|real_time)"
_GRAPH = "(lockstep|real_time)"
_PARAMETER = r"parameter: {}, (set|changed), another value \({}\)"

LET_PASS: tuple[tuple[str, str], ...] = (
    (
        (
            rf"{_ANY}: origin: (started_utc|commit|trunk_\w+|numpy|numba|rosbags|python|platform"
            r"|host|ros_distro), .*"
        ),
        "origin: where and by which version it was recorded; digests alone cover it",
    ),
    (rf"{_ANY}: origin: a key more", "origin: a note more; digests alone cover it"),
    (
        "offline: origin: scenario, .*",
        "origin: an offline run has its scenario's name nowhere else",
    ),
    (f"{_GRAPH}: origin: rmw, .*", "origin: which middleware carried the messages"),
    (
        rf"{_ANY}: bytes: \S+ one message with a tail",
        "bytes after a message's end: middleware leaves some there, no reader looks at them",
    ),
    (
        (
            rf"{_ANY}: order: \S+ after all others|{_ANY}: order across topics: .*"
            rf"|{_GRAPH}: parameters' message: \w+, (set|changed), to the end"
        ),
        "order across topics: in simulated time stamps give it, in real time log times",
    ),
    (
        (
            r"offline: event moved: /((fuzzy_pid|disturbance) retuned|fuzzy_pid (reset|activated)"
            r"|pid (de)?activated), .*"
            r"|offline: event moved: /simulator (retuned|reset|started|fell), to the beginning"
            r"|offline: parameters' message: ((pid|disturbance|simulator), set|\w+, changed), to the end"
        ),
        "order in an offline file: stamps give it; of one node and one stamp it stays as it is",
    ),
    (
        rf"{_GRAPH}: event moved: /\w+ configured, to the beginning",
        "order between the events of different nodes",
    ),
    (
        rf"{_GRAPH}: event's values: /(fuzzy_pid|pid|disturbance|simulator) configured, another process",
        "which process a node was; digests alone cover it",
    ),
    (
        rf"{_GRAPH}: event moved: /\w+ published, to the end",
        "order between the events of different nodes, at their ends",
    ),
    (
        r"lockstep: (event removed: /\w+ published|events: all published removed)",
        "published: in lock-step the states alone tell how many messages there have to be",
    ),
    (
        r"real_time: event stamped: /(pid|fuzzy_pid|disturbance) published - a period",
        "published: in real time a node may not have seen the last state",
    ),
    (
        "lockstep: event stamped: /pid published - a period",
        "published: in lock-step nothing waits for a controller whose turn is over",
    ),
    (
        "real_time: events: all disturbed removed",
        "disturbed: every disturbance that the simulator took is on record",
    ),
    (
        (
            rf"{_GRAPH}: (event removed: /\w+ ready|event moved: /recorder ready, to the end"
            r"|event stamped: /\w+ ready (\+ 1 ns|\+ a period))"
            rf"|{_GRAPH}: events: all ready removed"
        ),
        "ready: how the start was waited for; no bit of a state or command depends on it",
    ),
    (
        r"real_time: log times: \S+ all log and publish times .*",
        "log times in real time: when messages arrived; the verdict names it as not judged",
    ),
    (
        "lockstep: mode: 'real_time', parameters too, by a wall clock",
        "mode, every node's parameters and all log times together: a run in real time with no answer late",
    ),
    (rf"{_ANY}: topics: all in a namespace, nodes too", "a namespace is a name"),
    (
        (
            rf"{_ANY}: event doubled: /(fuzzy_pid|simulator) reset, at once"
            r"|offline: event doubled: /fuzzy_pid reset, at the end"
        ),
        "a second reset between the same two states has no effect",
    ),
    (
        (
            rf"{_ANY}: event added: (fuzzy_pid (reset|deactivated)|pid (reset|activated|cleaned up)"
            r"|simulator reset) at the end"
            rf"|{_GRAPH}: event added: (\w+ deactivated|simulator paused) at the end"
        ),
        "an event stamped with the last state: it takes effect after the run",
    ),
    (
        (
            rf"{_ANY}: event added: fuzzy_pid reset half way"
            r"|offline: event added: fuzzy_pid cleaned up (half way|at the end)"
        ),
        "a reset of a controller while another acts: it starts from nothing anyway",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"\w+\.autostart", r"0"),
        "autostart: who makes the node active; its events say that it was",
    ),
    (
        "offline: " + _PARAMETER.format(r"\w+\.lockstep\.enabled", r"0"),
        "lockstep.enabled: an offline run has no nodes that could wait",
    ),
    (
        rf"{_ANY}: "
        + _PARAMETER.format(
            r"simulator\.(wait_for|lockstep\.(timeout|window)|publish_clock)", "[01]"
        )
        + rf"|{_ANY}: "
        + _PARAMETER.format(r"simulator\.lockstep\.speed", "0")
        + "|lockstep: "
        + _PARAMETER.format(r"simulator\.lockstep\.speed", "1")
        + rf"|{_ANY}: "
        + _PARAMETER.format(r"simulator\.controllers", r"\d"),
        "waiting, pace and clock of the simulator: no bit of a state or command depends on them",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"simulator\.command_timeout", r"[01]"),
        "command_timeout: nothing was older than the one or the other",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"simulator\.max_effort", r"1"),
        "max_effort: no command came near it",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"simulator\.sensor\.(position|velocity)_limit", "1"),
        "a sensor's limit that was not reached",
    ),
    (
        rf"{_ANY}: "
        + _PARAMETER.format(
            r"simulator\.link\.(seed|command\.missing|\w+\.(jitter_kind|duplicates|order))", "0"
        )
        + rf"|{_ANY}: "
        + _PARAMETER.format(r"simulator\.link\.(seed|\w+\.burst\.(end|loss))", "1"),
        "links, of which there are none",
    ),
    (
        rf"{_ANY}: "
        + _PARAMETER.format(r"simulator\.operator\.(force|torque)", "0")
        + rf"|{_ANY}: "
        + _PARAMETER.format(r"simulator\.operator\.timeout", "[01]"),
        "the operator's limits: nobody pushed",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"(fuzzy_pid|pid)\.(u_clamp_m\w\w|i_clamp_m\w\w)", r"1"),
        "a limit that was not reached",
    ),
    (
        rf"{_ANY}: "
        + _PARAMETER.format(r"(fuzzy_pid|pid)\.antiwindup_strategy", r"\d")
        + rf"|{_ANY}: "
        + _PARAMETER.format(r"(fuzzy_pid|pid)\.tracking_time_constant", "0"),
        "anti-windup: no command was limited",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"(fuzzy_pid|pid)\.handover\.max_step", r"[01]"),
        "handover.max_step: the takeovers made no such step",
    ),
    (
        rf"{_ANY}: "
        + _PARAMETER.format(
            r"(fuzzy_pid\.reference\.(initial|step_time)"
            r"|pid\.reference\.(profile|initial|step_time|amplitude|frequency))",
            r"\d",
        ),
        "the reference's values that its profile does not use, or with which it is 0 as before",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"pid\.derivative_mode", r"0"),
        "derivative_mode: of a constant reference, error and measurement have the same derivative",
    ),
    (
        "(offline|real_time): " + _PARAMETER.format(r"pid\.update_rate", r"0"),
        "update_rate: an update is due at every state at either rate",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"(fuzzy_pid|pid)\.active\.times", r"[12]"),
        "active.times: the events say who acted when; whether a schedule or a user asked is not told",
    ),
    (
        "real_time: " + _PARAMETER.format(r"disturbance\.update_rate", "1"),
        "disturbance.update_rate: how far ahead it tells; what it tells does not depend on it",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"disturbance\.sine\.(channel|frequency|phase)", r"\d"),
        "a sine of amplitude 0",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"disturbance\.table\.(channel|interpolation)", r"\d"),
        "a table without rows",
    ),
    (
        rf"{_ANY}: "
        + _PARAMETER.format(r"disturbance\.pulse\.random_(until|seed)", r"\d")
        + rf"|{_ANY}: "
        + _PARAMETER.format(r"disturbance\.pulse\.random_from", "0"),
        "random pulses, of which there are none",
    ),
    (
        rf"{_ANY}: " + _PARAMETER.format(r"disturbance\.pulse\.random_count", r"\d"),
        "random pulses that start after the end of the run",
    ),
    (
        rf"{_GRAPH}: "
        + _PARAMETER.format(
            r"recorder\.(output|overwrite|compression|flush_interval|lockstep\.topics)", r"\d"
        ),
        "how the recorder writes: the file is there, and whole",
    ),
    (
        rf"{_GRAPH}: parameter removed: recorder\.markers, set",
        "recorder.markers left out: as an earlier version wrote it, without a picture",
    ),
)


def pattern_for(name: str) -> str:
    """Return the pattern that lists an edit; empty if none does."""
    return next((pattern for pattern, _ in LET_PASS if re.fullmatch(pattern, name)), "")


def reason_for(name: str) -> str:
    """Return why an edit may pass; empty if it must not."""
    return next((reason for pattern, reason in LET_PASS if re.fullmatch(pattern, name)), "")
