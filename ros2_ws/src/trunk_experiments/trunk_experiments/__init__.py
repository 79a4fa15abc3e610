"""Scenarios, offline runs, graph runs and everything behind the ``trunk`` command.

Contract: only ``*_node.py`` imports ROS; every offline verb works without ROS installed.
"""
