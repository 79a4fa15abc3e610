"""Writes, reads and repairs any MCAP recording of ROS 2. Knows nothing of plants, controllers or verdicts."""
