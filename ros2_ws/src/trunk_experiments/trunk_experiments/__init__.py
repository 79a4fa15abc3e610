"""The ``trunk`` command and the library, kits of conformance, labs, environments, controllers as C.

Contract: nothing imports ROS; every offline verb works without ROS installed.
"""
