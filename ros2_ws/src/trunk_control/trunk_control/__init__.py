"""Control laws: PID, fuzzy inference, Fuzzy-PID, reference profiles; and their nodes.

Contract: only ``*_node.py`` imports ROS. Never imports ``trunk_sim``.
"""
