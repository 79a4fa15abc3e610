"""The executables that `ros2 run` starts: quick to load, and they end cleanly on a signal at any time."""

from __future__ import annotations

from .node import early_signals

recorder = early_signals.node(
    "trunk_msgs_util.node.recorder_node",
    undone="recorder: stopped while it was loading: nothing is recorded\n",
)
