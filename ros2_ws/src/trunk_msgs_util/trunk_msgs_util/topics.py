"""Topic names (relative, so that namespaces and remaps work) and their message types."""

from __future__ import annotations

JOINT_STATES = "joint_states"
GROUND_TRUTH = "ground_truth/joint_states"
EFFORT_COMMAND = "effort_command"
DISTURBANCE = "disturbance"
REFERENCE = "reference"
RUN_PARAMETERS = "run/parameters"
RUN_EVENTS = "run/events"
RECORDER_PROGRESS = "recorder/progress"

JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
PARAMETER_EVENT_TYPE = "rcl_interfaces/msg/ParameterEvent"
DIAGNOSTIC_ARRAY_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

CONTROLLERS = ("pid", "fuzzy_pid")

# The names of a ``~/state`` record, in order; their values stand in ``position``.
STATE_NAMES = (
    "reference",
    "measurement",
    "error",
    "error_rate",
    "p_term",
    "i_term",
    "d_term",
    "kp",
    "ki",
    "kd",
    "alpha",
    "unsaturated",
    "effort",
)


def controller_state(controller: str) -> str:
    """Return the topic of a controller node's ``~/state``."""
    return f"{controller}/state"


def evidence_types(controllers: tuple[str, ...] = CONTROLLERS) -> dict[str, str]:
    """Return the recorded topics and their types."""
    joints = (JOINT_STATES, GROUND_TRUTH, EFFORT_COMMAND, DISTURBANCE, REFERENCE)
    states = tuple(controller_state(name) for name in controllers)
    return {
        **dict.fromkeys(joints + states, JOINT_STATE_TYPE),
        RUN_PARAMETERS: PARAMETER_EVENT_TYPE,
        RUN_EVENTS: DIAGNOSTIC_ARRAY_TYPE,
    }
