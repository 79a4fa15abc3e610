"""What marks a file as one of ours: its profile and library, and the names of its metadata records."""

from __future__ import annotations

PROFILE, LIBRARY = "ros2", "trunk_msgs_util mcap-python/"
PROVENANCE = "trunk_provenance"
END = "trunk_end"
