"""Writes, reads and repairs any MCAP recording of ROS 2. Knows no plant, no controller, no verdict."""
