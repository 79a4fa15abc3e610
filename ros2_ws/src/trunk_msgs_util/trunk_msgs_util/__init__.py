"""Names, units, declarations, recordings and node base classes that all packages share.

Contract: only the folder ``node`` imports ROS; everything else works without ROS installed.
"""
