"""The names in the graph: topics, with their types, and events.

Topic names are relative, so that namespaces and remaps work; docs/concepts.md has the rest.
"""

from __future__ import annotations

from enum import Enum

JOINT_STATES = "joint_states"
GROUND_TRUTH = "ground_truth/joint_states"
EFFORT_COMMAND = "effort_command"
DISTURBANCE = "disturbance"
REFERENCE = "reference"
OPERATOR_REQUEST = "operator/request"
OPERATOR_PUSH = "operator/push"
PLANT_INPUTS = "plant/inputs"
RUN_PARAMETERS = "run/parameters"
RUN_EVENTS = "run/events"
RECORDER_PROGRESS = "recorder/progress"

# The name of an external controller as long as it has none.
EXTERNAL = "external"

# The picture of a run, for 3-D views.
MARKERS = "markers"
TF = "tf"
ROBOT_DESCRIPTION = "robot_description"

JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
PARAMETER_EVENT_TYPE = "rcl_interfaces/msg/ParameterEvent"
DIAGNOSTIC_ARRAY_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
MARKER_ARRAY_TYPE = "visualization_msgs/msg/MarkerArray"
STRING_TYPE = "std_msgs/msg/String"
TF_TYPE = "tf2_msgs/msg/TFMessage"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

# The provenance's name of the mode in which the wall clock paces a run.
REAL_TIME = "real_time"

PICTURES = {MARKERS: MARKER_ARRAY_TYPE, TF: TF_TYPE, ROBOT_DESCRIPTION: STRING_TYPE}

# The name under which ros2_control's users expect what CONTROLLER/state has.
CONTROLLER_STATE = "~/controller_state"

# Late subscribers get the past messages of these topics; on the others, only new ones.
LATCHED = (RUN_PARAMETERS, RUN_EVENTS, ROBOT_DESCRIPTION)
LATCHED_DEPTH = 1000
LIVE_DEPTH = 5000
# rclpy's publishers keep this many messages by default; older ones not yet received are lost.
STRANGERS_DEPTH = 10

# Discovery's name for a node of which it knows only an endpoint.
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"
# Fast DDS's name, as its ROS middleware gives it, for a participant that no ROS node belongs to.
BARE_NODE = "_CREATED_BY_BARE_DDS_APP_"

# The names in a row of ``plant/inputs``, in order; values are in ``position``, their ages in ``velocity``.
INPUT_NAMES = ("command", "hip_force", "trunk_torque", "hip_offset", "trunk_offset")


def evidence(topic: str) -> str:
    """Return the topic of the recorder's copies of a topic of our nodes, past messages included.

    ROS 2's tools hide names with a part that begins with an underscore.
    """
    folder, _, name = topic.rpartition("/")
    return f"{folder}/_{name}" if "/" in topic else f"_{name}"


def controller_state(controller: str) -> str:
    """Return the topic of a controller node's ``~/state``."""
    return f"{controller}/state"


def own_reference(controller: str) -> str:
    """Return the topic of the references for one controller node only, ``~/reference``."""
    return f"{controller}/{REFERENCE}"


def is_controller_state(relative: str) -> bool:
    """Return True for the name of some node's ``~/state``."""
    return relative.count("/") == 1 and relative.endswith("/state")


def evidence_types(controllers: tuple[str, ...], mode: str = "lockstep") -> dict[str, str]:
    """Return the recorded topics and their types, in a mode as the provenance names it.

    In lock-step, and offline, what acts on the plant follows from the schedule.
    """
    joints: tuple[str, ...] = (
        JOINT_STATES,
        GROUND_TRUTH,
        EFFORT_COMMAND,
        DISTURBANCE,
        REFERENCE,
    )
    if mode == REAL_TIME:
        joints = (*joints, PLANT_INPUTS)
    states = tuple(controller_state(name) for name in controllers)
    return {
        **dict.fromkeys(joints + states, JOINT_STATE_TYPE),
        RUN_PARAMETERS: PARAMETER_EVENT_TYPE,
        RUN_EVENTS: DIAGNOSTIC_ARRAY_TYPE,
    }


class Event(str, Enum):
    """The ``message`` of a status on ``run/events``; the node is its ``name``.

    A member is also a string, so that it compares equal to what a message or a file holds. The class
    is what the standard library calls a StrEnum from Python 3.11 on.
    """

    UNCONFIGURED = "unconfigured"
    CONFIGURED = "configured"
    ACTIVATED = "activated"
    DEACTIVATED = "deactivated"
    CLEANED_UP = "cleaned up"
    READY = "ready"
    STARTED = "started"
    RESET = "reset"
    RETUNED = "retuned"
    PAUSED = "paused"
    RESUMED = "resumed"
    FELL = "fell"
    CONNECTED = "connected"
    DISCONNECTED = "disconnected"
    REFUSED = "refused"
    PASSED_ON = "passed on"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"
    PUBLISHED = "published"

    __str__ = str.__str__


# How bad a status is, in diagnostic_msgs.
LEVEL_OK, LEVEL_WARN, LEVEL_ERROR = 0, 1, 2

# Sent by the simulator, each of these ends the run.
ENDS = (Event.FINISHED, Event.STOPPED, Event.FAILED)

_DIGITS = 18  # of an integer of 64 bits; Python itself refuses to read thousands of them


def as_count(text: str) -> int:
    """Return the count that a value of an event gives; -1 if it is none."""
    return int(text) if text.isdecimal() and len(text) <= _DIGITS else -1
