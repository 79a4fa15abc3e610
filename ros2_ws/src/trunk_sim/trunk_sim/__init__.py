"""The plant: integrator, actuator, sensors, links, disturbances; and their two nodes.

The equations of motion are in `trunk_msgs_util.mechanics`: controllers with a model use them, too.

Contract: only ``*_node.py`` imports ROS. Never imports ``trunk_control``.
"""
