"""The executables: what `ros2 run` starts, quick to load and orderly to end from its first moment on."""

from __future__ import annotations

from trunk_msgs_util.node import early_signals

pid = early_signals.node("trunk_control.pid_node")
fuzzy_pid = early_signals.node("trunk_control.fuzzy_pid_node")
lqr = early_signals.node("trunk_control.lqr_node")
computed_torque = early_signals.node("trunk_control.computed_torque_node")
