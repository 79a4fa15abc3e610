"""Plants: integrator, drive, sensors, links, disturbances, pacing; and the simulator and disturbance nodes.

The equations of motion are in `trunk_core.mechanics`: controllers with a model use them, too.

Contract: only ``*_node.py`` imports ROS. Never imports ``trunk_control``.
"""
