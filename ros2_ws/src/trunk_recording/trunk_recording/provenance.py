"""Where a run comes from: versions, commit, machine, time. Gathering it never fails.

Readers need only `ARITHMETIC` and `FORMAT`; what a run's writer needs is imported when it gathers.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path

from trunk_core import PACKAGES
from trunk_core.plugins import LAW_GROUP, PLANT_GROUP

# How numbers are computed: sums, products, quotients and roots of IEEE 754 doubles, and the functions of
# `elementary` and `noise`. Any change of a bit needs a new name.
ARITHMETIC = "portable-1"

# What a recording of ours holds, and how; files of another format are not read. It moves when what is on
# record changes its meaning. A fact that is added leaves it: readers ask for none that a file does not have.
FORMAT = "2"

UNKNOWN = "unknown"
NONE = "none"
_PATIENCE_S = 5.0  # for git

_OWN = "trunk_experiments"
PACKAGE = "package "  # what the names of other packages begin with
_LIBRARIES = ("numpy", "numba", "mcap", "rosbags")
_COMMIT = (
    "TRUNK_COMMIT"  # the environment's, where there are sources without a checkout: in an image
)

# What says when and where, not what: results that depend on neither leave it out.
OF_MACHINE = frozenset({"started_utc", "platform", "host", "ros_distro", "rmw"})


def gather(**known: str) -> dict[str, str]:
    """Return the facts about code and machine; ``known`` (scenario, rmw ...) overrides it."""
    import platform
    from datetime import datetime, timezone

    origin = {
        "started_utc": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "commit": _commit(),
        **{name: _version(name) for name in PACKAGES + _LIBRARIES},
        "arithmetic": ARITHMETIC,
        "format": FORMAT,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "host": platform.node() or UNKNOWN,
        "ros_distro": os.environ.get("ROS_DISTRO") or NONE,
        "rmw": os.environ.get("RMW_IMPLEMENTATION") or NONE,
        **packages_of_plugins(),
    }
    return {**origin, **known}


def another_version(recorded: Mapping[str, str]) -> str:
    """Return which version recorded and which judges, in a line; empty if it is the same, or not known."""
    there, here = _version_in(recorded), _here()
    known = [pair for pair in zip(there, here, strict=True) if UNKNOWN not in pair]
    if all(one == other for one, other in known):
        return ""
    recorder, judge = (f"version {v:.20} (commit {commit:.12})" for v, commit in (there, here))
    return f"recorded by {recorder}, judged by {judge}"


def _version_in(facts: Mapping[str, str]) -> tuple[str, str]:
    return facts.get(_OWN, UNKNOWN), facts.get("commit", UNKNOWN).removesuffix("+dirty")


@cache
def _here() -> tuple[str, str]:
    return _version_in({_OWN: _version(_OWN), "commit": _commit()})


def unrepeatable(arithmetic: str) -> str:
    """Return why numbers in an arithmetic (empty: none is named) cannot be recomputed; empty if they can."""
    if arithmetic == ARITHMETIC:
        return ""
    if arithmetic:
        return (
            f"recorded in arithmetic {arithmetic!r}, here it is {ARITHMETIC!r}: its bits cannot be "
            "recomputed; use the version of this project that recorded it"
        )
    return (
        f"no provenance that names its arithmetic ({ARITHMETIC}): its last bits depend on the machine "
        "that recorded it, and cannot be recomputed; record the run again"
    )


def packages_of_plugins() -> dict[str, str]:
    """Return version and sources of each package, other than ours, that registers a controller or a plant.

    ``{"package NAME": "VERSION, sources DIGEST"}``: 12 hex digits of the SHA-256 of the Python files of the
    top-level modules that hold them. None of them is imported.
    """
    from importlib.metadata import entry_points

    modules: dict[tuple[str, str], set[str]] = {}
    entries = (entry for group in (LAW_GROUP, PLANT_GROUP) for entry in entry_points(group=group))
    for entry in entries:
        if entry.dist is not None and entry.dist.name not in PACKAGES:
            about = entry.dist.name.replace("-", "_"), entry.dist.version
            modules.setdefault(about, set()).add(entry.module.partition(".")[0])
    return {
        f"{PACKAGE}{name}": f"{version}, sources {_sources(sorted(names))}"
        for (name, version), names in sorted(modules.items())
    }


def _sources(modules: list[str]) -> str:
    import hashlib
    from importlib.util import find_spec

    digest = hashlib.sha256()
    for module in modules:
        with suppress(ImportError, ValueError, OSError):
            spec = find_spec(module)
            folders = [Path(path) for path in (spec and spec.submodule_search_locations) or ()]
            files = [(path.relative_to(f), path) for f in folders for path in f.rglob("*.py")]
            if spec is not None and not folders and spec.origin:
                files = [(Path(Path(spec.origin).name), Path(spec.origin))]
            for name, file in sorted(files):
                digest.update(name.as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


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
    """Return the commit of the checkout that tracks this file, with ``+dirty`` if changed.

    Without one, return what TRUNK_COMMIT says.
    A git that hangs, as on a file system that is away, leaves it unknown: the run does not wait for it.
    """
    import subprocess

    here = Path(__file__).resolve()
    deadline = time.monotonic() + _PATIENCE_S

    def git(*arguments: str) -> str:
        process = subprocess.Popen(
            ["git", "-C", str(here.parent), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            said, _ = process.communicate(timeout=deadline - time.monotonic())
        except subprocess.TimeoutExpired:
            process.kill()  # and not wait: it may be beyond signals
            raise
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, "git")
        return said.strip()

    with suppress(OSError, subprocess.CalledProcessError, ValueError):
        try:
            git("ls-files", "--error-unmatch", here.name)
            return git("describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+dirty")
        except subprocess.TimeoutExpired:
            print(
                f"trunk: warning: git does not answer within {_PATIENCE_S:g} s: the commit is unknown",
                file=sys.stderr,
            )
            return UNKNOWN
    return os.environ.get(_COMMIT) or NONE
