"""Control laws, from PID to state feedback, the rule bases of the fuzzy ones, references; and their nodes.

Contract: only ``*_node.py`` imports ROS. Never imports ``trunk_sim``.
"""
