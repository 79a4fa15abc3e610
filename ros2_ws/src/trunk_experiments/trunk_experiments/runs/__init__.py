"""Runs plans, in the ROS 2 graph and offline."""
