"""The executables: what `ros2 run` starts, quick to load and orderly to end from its first moment on."""

from __future__ import annotations

from .node import early_signals

recorder = early_signals.node("trunk_msgs_util.node.recorder_node")
