"""Names, units, declarations, recordings and metrics that every package of the project shares.

Contract: only ``*_node.py``, ``conversions.py``, ``qos.py`` and ``parameters.py`` import ROS; all else
works where ROS is not installed.
"""
