"""Middleware settings that a run needs; a user's own settings are kept."""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = Path(__file__).with_name("fastdds.xml")


def prepare() -> None:
    """Give Fast DDS our file of profiles, unless one is set; before rclpy is initialised.

    Processes that are started one after the other find each other sooner by it. What was sent while a
    reader was only half discovered is repaired at the next heartbeat, and the wait for acknowledgements
    before a node ends takes one.
    """
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILES))
