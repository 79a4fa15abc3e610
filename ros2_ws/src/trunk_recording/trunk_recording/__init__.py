"""Writes, reads and repairs any MCAP recording of ROS 2, its joint states as columns.

Knows nothing of plants, controllers or verdicts.
"""
