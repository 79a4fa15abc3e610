"""A plan and its run: layers of parameters, the one closed loop, offline or as a graph of nodes.

Contract: only ``*_node.py`` imports ROS.
"""
