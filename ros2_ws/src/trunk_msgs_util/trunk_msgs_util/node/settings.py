"""The environment's settings that ROS 2 reads: checked first, with one line for what it cannot use."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from math import inf
from pathlib import Path

from ..errors import TrunkError

_LAST_DOMAIN = 232  # beyond it, DDS has no ports left
_RANGES = ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT")


class SettingError(TrunkError):
    """A setting of the environment that ROS 2 cannot use: its name, its value, what is allowed."""


def check(environment: Mapping[str, str] = os.environ) -> None:
    """Raise SettingError where ROS 2 would end with a traceback, or its nodes would not find one another."""
    _check_domain(environment.get("ROS_DOMAIN_ID", ""))
    _check_range(environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", ""))
    _check_log_folder(environment)
    patience(environment)


def patience(environment: Mapping[str, str] = os.environ) -> float:
    """Return the factor on an ending node's wait for its recorder: TRUNK_PATIENCE, 1 by default.

    Raises SettingError.
    """
    text = environment.get("TRUNK_PATIENCE") or "1"
    with suppress(ValueError):
        if 0.0 < float(text) < inf:
            return float(text)
    raise SettingError(
        f"TRUNK_PATIENCE={text} is not allowed: a factor above 0 for slow machines, or unset it"
    )


def _check_domain(text: str) -> None:
    if text and not (text.isascii() and text.isdecimal() and int(text) <= _LAST_DOMAIN):
        raise SettingError(
            f"ROS_DOMAIN_ID={text} is not allowed: a whole number from 0 to {_LAST_DOMAIN}, or unset it"
        )


def _check_range(text: str) -> None:
    if not text or text in _RANGES:
        return
    reason = "nodes do not find one another with this value" if text == "OFF" else "not known"
    raise SettingError(
        f"ROS_AUTOMATIC_DISCOVERY_RANGE={text} is not allowed: {reason}; {', '.join(_RANGES)}, or unset it"
    )


def _check_log_folder(environment: Mapping[str, str]) -> None:
    """Find the folder of the nodes' logs as rcl does, and see whether it can be written to."""
    below = {"ROS_LOG_DIR": "", "ROS_HOME": "log", "HOME": ".ros/log"}
    name = next((name for name in below if environment.get(name)), "")
    if not name:
        raise SettingError(
            "neither ROS_LOG_DIR nor HOME is set: set ROS_LOG_DIR to a folder for logs"
        )
    folder = Path(environment[name]).expanduser() / below[name]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        why = "" if os.access(folder, os.W_OK | os.X_OK) else "it cannot be written to"
    except OSError as error:
        why = error.strerror or str(error)
    if why:
        raise SettingError(
            f"{name}={environment[name]}: no logs can be written to {folder} ({why}): set ROS_LOG_DIR to "
            "a folder that can be written to"
        )
