"""What `trunk verify` lets pass although the digests were written anew, and why.

A pattern matches an edit's whole name: the base, the kind, what is edited. What is listed may pass:
none of it changes a state, a command, a term, a disturbance that acted, a fall or a metric.
"""

import re

_ANY = "(offline|lockstep|real_time)"

# Events on which no state depends: how the run was started, watched and held, by node.
_STILL = (
    r"/?(recorder [a-z ]+?|disturbance (?!retuned)[a-z ]+?"
    r"|simulator (configured|activated|deactivated|cleaned up|paused|resumed|published|ready)"
    r"|(fuzzy_pid|pid) (configured|ready|published|paused|resumed|started|stopped|finished|passed on))"
)

# Parameters whose other value changes nothing, by the reason, and which of the values tried those are.
_UNUSED = {
    "waiting, pace and clock of the simulator: no bit of a state or command depends on them": {
        r"simulator\.(wait_for|lockstep\.(timeout|window)|publish_clock)": "[01]",
        r"simulator\.lockstep\.speed": r"\d",
        r"simulator\.controllers": r"\d",
    },
    "command_timeout: nothing was older than the one or the other": {
        r"simulator\.command_timeout": "[01]",
    },
    "max_effort: no command came near it": {r"simulator\.max_effort": "1"},
    "a sensor's limit that was not reached": {
        r"simulator\.sensor\.(position|velocity)_limit": "1",
    },
    "links, of which there are none": {
        r"simulator\.link\.(seed|command\.missing|\w+\.(jitter_kind|duplicates|order))": "0",
        r"simulator\.link\.(seed|\w+\.burst\.(end|loss))": "1",
    },
    "the operator's limits: nobody pushed": {
        r"simulator\.operator\.(force|torque)": "0",
        r"simulator\.operator\.timeout": "[01]",
    },
    "a limit that was not reached": {r"(fuzzy_pid|pid)\.(u_clamp_m\w\w|i_clamp_m\w\w)": "1"},
    "anti-windup: no command was limited": {
        r"(fuzzy_pid|pid)\.antiwindup_strategy": r"\d",
        r"(fuzzy_pid|pid)\.tracking_time_constant": "0",
    },
    "handover.max_step: the takeovers made no such step": {
        r"(fuzzy_pid|pid)\.handover\.max_step": "[01]",
    },
    "gap.max_periods: there was no such gap": {r"(fuzzy_pid|pid)\.gap\.max_periods": r"\d"},
    "the reference's values that its profile does not use, or with which it is 0 as before": {
        r"(fuzzy_pid\.reference\.(initial|step_time)"
        r"|pid\.reference\.(profile|initial|step_time|amplitude|frequency))": r"\d",
    },
    "derivative_mode: of a constant reference, error and measurement have the same derivative": {
        r"pid\.derivative_mode": "0",
    },
    "update_rate: an update is due at every state at either rate": {r"pid\.update_rate": "0"},
    "active.times: the events say who acted when; whether a schedule or a user asked is not told": {
        r"(fuzzy_pid|pid)\.active\.times": "[12]",
    },
    "disturbance.update_rate: how far ahead it tells; what it tells does not depend on it": {
        r"disturbance\.update_rate": r"\d",
    },
    "a sine of amplitude 0": {r"disturbance\.sine\.(channel|frequency|phase)": r"\d"},
    "a table without rows": {r"disturbance\.table\.(channel|interpolation)": r"\d"},
    "random pulses, of which there are none": {
        r"disturbance\.pulse\.random_(until|seed)": r"\d",
        r"disturbance\.pulse\.random_from": "0",
    },
    "random pulses that start after the end of the run": {
        r"disturbance\.pulse\.random_count": r"\d",
    },
}


def _another_value(name: str, values: str) -> str:
    return rf"{_ANY}: parameter: {name}, (set|changed), another value \({values}\)"


ACCEPTED: tuple[tuple[str, str], ...] = (
    (
        rf"{_ANY}: origin: (?!record|another record).*",
        "origin: it follows from nothing else; digests alone cover it",
    ),
    (
        (
            rf"{_ANY}: (header|channels|metadata|bytes|topics): .*|{_ANY}: schemas: .* (text|name|encoding)"
            rf"|{_ANY}: end: (?!record|another record).*|(offline|lockstep): frame: .*"
        ),
        "frames, channels, schemas, metadata and what other programs would show: no number of the run",
    ),
    (
        rf"{_ANY}: (sequence|log times|order|order across topics): .*",
        "sequence numbers, log and publish times, and order in the file: stamps give the order of the run",
    ),
    (
        rf"{_ANY}: event moved: .*|{_ANY}: event's head: .*",
        "when an event was received: its stamp says where it belongs",
    ),
    (
        (
            rf"{_ANY}: event's content: .*, "
            r"(another level|another hardware_id|a value more|a second status|a frame_id)"
        ),
        "what surrounds an event in its message",
    ),
    (
        (
            rf"{_ANY}: event( \w+|'s \w+): {_STILL}( half way| at the end|,.*| \+.*| -.*| to .*|)"
            rf"|{_ANY}: events: all (of (recorder|disturbance|simulator)"
            r"|ready|published|configured|paused|resumed) .*"
            rf"|{_ANY}: event stamped: /simulator started .*"
        ),
        "events on which no state depends: how a run was started, watched, held and counted",
    ),
    (
        rf"{_ANY}: event added: (simulator (dis)?connected|\w+ refused) .*",
        "that an external node came, or that a message was refused: what acted is on record",
    ),
    (
        rf"{_ANY}: event doubled: /(fuzzy_pid|pid|simulator) (activated|deactivated|reset|fell), .*",
        "a second turn, reset or fall between the same two states",
    ),
    (
        (
            rf"{_ANY}: event added: ((fuzzy_pid|pid) (reset|activated|deactivated|cleaned up)"
            r"|simulator (reset|paused)) (half way|at the end)"
        ),
        "a reset or a turn of a controller while another acts, and any after the last state",
    ),
    (
        rf"{_ANY}: event stamped: /(fuzzy_pid|pid) (reset|activated|deactivated) \+ 1 ns",
        "an event moved between the same two states",
    ),
    (
        r"real_time: event( \w+|'s \w+): /(fuzzy_pid|pid) (activated|deactivated)( |,|$).*",
        "in real time, a turn that the controller's own schedule makes at the same state",
    ),
    (
        (
            rf"{_ANY}: parameter (another type|a value of another type besides|doubled): .*"
            rf"|{_ANY}: parameter (not set|removed): recorder\..*"
            rf"|{_ANY}: parameter removed: pid\.gap\.max_periods, .*"  # as in older files
        ),
        "how a parameter is written, its value being the same",
    ),
    (
        (
            rf"{_ANY}: parameters' message: \w+, (set|changed), "
            r"(sequence|publish time|log time|one deleted too"
            r"|order of parameters|to the end).*"
            rf"|{_ANY}: parameters' message: \w+, set, stamp .*"
            r"|real_time: parameters' message: disturbance, set, doubled"
        ),
        "when a set of parameters was received, and how it is written",
    ),
    (
        rf"{_ANY}: parameter: recorder\..*",
        "the recorder's own parameters: the file is there",
    ),
    (
        "lockstep: mode: 'offline', (parameters too, )?without lifecycle",
        "a lock-step run without its nodes' events, called offline: the same numbers",
    ),
    (
        rf"{_ANY}: parameter: \w+\.autostart, .*|offline: parameter: \w+\.lockstep\.enabled, .*",
        "autostart and lockstep.enabled where no node was started",
    ),
    *(
        ("|".join(_another_value(*each) for each in values.items()), reason)
        for reason, values in _UNUSED.items()
    ),
)


def pattern_for(name: str) -> str:
    """Return the pattern that lists an edit; empty if none does."""
    return next((pattern for pattern, _ in ACCEPTED if re.fullmatch(pattern, name)), "")


def reason_for(name: str) -> str:
    """Return why an edit may pass; empty if it must not."""
    return next((reason for pattern, reason in ACCEPTED if re.fullmatch(pattern, name)), "")
