"""The executables that `ros2 run` starts: quick to load, and they end cleanly on a signal at any time."""

from __future__ import annotations

from trunk_msgs_util.node import early_signals

simulator = early_signals.node("trunk_sim.simulator_node")
disturbance = early_signals.node("trunk_sim.disturbance_node")
