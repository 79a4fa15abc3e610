"""What all nodes share: life cycle, parameters, executor, sources of messages; pictures; and the recorder.

Contract: only the folder ``node`` imports ROS; everything else works without ROS installed.
"""
