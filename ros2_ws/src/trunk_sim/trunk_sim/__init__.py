"""The plant: equations of motion, integrator, sensors, disturbances; and their two nodes.

Contract: only ``*_node.py`` imports ROS. Never imports ``trunk_control``.
"""
