"""Where a run comes from: versions, commit, machine, time. Gathering it never fails.

Readers need only `ARITHMETIC`; what a run's writer needs is imported when it gathers.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

# How numbers are computed: sums, products, quotients and roots of IEEE 754 doubles, and the functions of
# `elementary` and `noise`. A change of any bit is a new name.
ARITHMETIC = "portable-1"

UNKNOWN = "unknown"
NONE = "none"

_PROJECT = ("trunk_msgs_util", "trunk_sim", "trunk_control", "trunk_experiments")
_LIBRARIES = ("numpy", "numba", "mcap", "rosbags")


def gather(**known: str) -> dict[str, str]:
    """Return what can be found out about code and machine; ``known`` (scenario, rmw ...) overrides it."""
    import platform
    from datetime import datetime, timezone

    found = {
        "started_utc": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "commit": _commit(),
        **{name: _version(name) for name in _PROJECT + _LIBRARIES},
        "arithmetic": ARITHMETIC,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "host": platform.node() or UNKNOWN,
        "ros_distro": os.environ.get("ROS_DISTRO") or NONE,
        "rmw": os.environ.get("RMW_IMPLEMENTATION") or NONE,
    }
    return {**found, **known}


def _version(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version
    from xml.etree import ElementTree

    with suppress(PackageNotFoundError):
        return version(package)
    # A source tree that is not installed: its manifest has the version.
    manifest = Path(__file__).resolve().parents[2] / package / "package.xml"
    with suppress(OSError, ElementTree.ParseError):
        return ElementTree.parse(manifest).findtext("version") or UNKNOWN
    return NONE


def _commit() -> str:
    """Return the commit of the checkout that tracks this file, with ``+dirty`` if changed."""
    import subprocess

    here = Path(__file__).resolve()

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", str(here.parent), *arguments],
            capture_output=True,
            text=True,
            timeout=5.0,
            check=True,
        ).stdout.strip()

    with suppress(OSError, subprocess.SubprocessError, ValueError):
        git("ls-files", "--error-unmatch", here.name)
        return git("describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+dirty")
    return NONE
