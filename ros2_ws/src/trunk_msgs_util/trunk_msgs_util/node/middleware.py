"""Middleware settings that a run needs; a user's own settings are kept."""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = Path(__file__).with_name("fastdds.xml")


def prepare() -> None:
    """Point Fast DDS to our profiles unless others are set; call it before rclpy is initialised.

    Processes started one after the other then discover each other sooner, and heartbeats are more frequent:
    the next one repairs what was sent to a half-discovered reader, and a node that ends waits for one.
    """
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILES))
