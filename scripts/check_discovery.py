#!/usr/bin/env python3
"""Measure how long a late process and a running one need to find each other over DDS.

    source scripts/env.sh && python scripts/check_discovery.py [--tries 100] [PROFILES.xml ...]

Six topics between the two, three each way. A try lasts from before the late process opens DDS until each
of the two has matched the other's six endpoints and knows the node behind each. The profiles take turns,
try by try, so that a busy machine disturbs them alike: compare the columns, not the seconds.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import NamedTuple

import click
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from trunk_experiments.console.tables import print_table
from trunk_msgs_util.node import middleware, qos

TOPICS = 3  # each way
SETTLED_S = 4.0  # the running process has made its first announcements
UNEVEN_S = 0.3  # a try comes at any phase of what the running process does periodically
LOOK_S = 0.001
HUNG_S = 60.0
FORK = multiprocessing.get_context("fork")
NOTHING = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <data_writer profile_name="unused"/>
</profiles>
"""


class Found(NamedTuple):
    """When one process found the other: times of the monotonic clock, s."""

    matched: float
    named: float


class Side:
    """One of the two nodes: three topics out, three in."""

    def __init__(self, name: str, other: str) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(name, start_parameter_services=False)
        self._other = other
        profile = qos.evidence()
        self._out = [
            self._node.create_publisher(JointState, f"from_{name}_{i}", profile)
            for i in range(TOPICS)
        ]
        self._in = [
            self._node.create_subscription(
                JointState, f"from_{other}_{i}", lambda message: None, profile
            )
            for i in range(TOPICS)
        ]

    def matched(self) -> int:
        """Return how many of the six endpoints have met their counterpart."""
        return sum(p.get_subscription_count() > 0 for p in self._out) + sum(
            s.get_publisher_count() > 0 for s in self._in
        )

    def named(self) -> bool:
        """Return True once the node behind each endpoint of the other is known."""
        endpoints = [
            *(self._node.get_subscriptions_info_by_topic(p.topic_name) for p in self._out),
            *(self._node.get_publishers_info_by_topic(s.topic_name) for s in self._in),
        ]
        return all(any(e.node_name == self._other for e in known) for known in endpoints)

    def find(self) -> Found:
        """Return when the other was found."""
        until(lambda: self.matched() == 2 * TOPICS)
        matched = time.monotonic()
        until(self.named)
        return Found(matched, time.monotonic())

    def close(self) -> None:
        """Leave in order, so that the other forgets this one at once."""
        self._node.destroy_node()
        rclpy.try_shutdown()


def until(condition: Callable[[], object]) -> None:
    """Poll until the condition holds; a process that hangs ends the check."""
    hung = time.monotonic() + HUNG_S
    while not condition():
        if time.monotonic() > hung:
            sys.exit(
                f"check_discovery: FAILED: the two did not find each other within {HUNG_S:g} s"
            )
        time.sleep(LOOK_S)


def run_early(pipe: Connection) -> None:
    """Be the running process: report each late one that was found, and wait until it has left."""
    side = Side("early", "late")
    pipe.send(None)
    while True:
        pipe.recv()
        pipe.send(side.find())
        until(lambda: side.matched() == 0)
        pipe.send(None)


def run_late(pipe: Connection) -> None:
    """Be the late process: report when it began and when it had found the running one."""
    began = time.monotonic()
    side = Side("late", "early")
    pipe.send((began, side.find()))
    pipe.recv()
    side.close()


@contextmanager
def process(target: Callable[[Connection], None]) -> Iterator[Connection]:
    """Run one of the two in a separate process; requests and answers go through a pipe."""
    ours, theirs = FORK.Pipe()
    child = FORK.Process(target=target, args=(theirs,), daemon=True)
    child.start()
    theirs.close()
    try:
        yield ours
    finally:
        child.join(0.0 if target is run_early else HUNG_S)
        child.kill()


def attempt(early: Connection) -> Found:
    """Return what one late process needed, s: the slower of the two sides."""
    early.send(None)
    with process(run_late) as late:
        began, one = late.recv()
        other = early.recv()
        late.send(None)
    early.recv()
    return Found(
        max(one.matched, other.matched) - began,
        max(one.named, other.named) - began,
    )


@click.command()
@click.option("--tries", default=100, show_default=True, help="Late processes for each profile.")
@click.option("--domain", default=60, show_default=True, help="The first ROS domain to use.")
@click.argument("profiles", nargs=-1, type=click.Path(exists=True, dir_okay=False))
def main(tries: int, domain: int, profiles: tuple[str, ...]) -> None:
    """Print how long it takes by Fast DDS's own settings, by ours and by other PROFILES."""
    with ExitStack() as stack:
        nothing = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "nothing.xml"
        nothing.write_text(NOTHING)
        files = {"Fast DDS alone": nothing, "ours": middleware.PROFILES}
        files |= {path.stem: path for path in map(Path, profiles)}
        running: dict[str, Connection] = {}
        for number, (name, file) in enumerate(files.items()):
            enter(file, domain + number)
            running[name] = stack.enter_context(process(run_early))
        for early in running.values():
            early.recv()
        time.sleep(SETTLED_S)
        chance = random.Random(1)
        took: dict[str, list[Found]] = {name: [] for name in files}
        for _ in range(tries):
            for number, (name, file) in enumerate(files.items()):
                enter(file, domain + number)
                time.sleep(chance.uniform(0.0, UNEVEN_S))
                took[name].append(attempt(running[name]))
    print_table(
        f"a late process and a running one, {tries} tries each, s",
        ("profile", "matched: median", "9 of 10", "worst", "named: median", "worst"),
        [(name, *figures(found)) for name, found in took.items()],
    )


def enter(file: Path, domain: int) -> None:
    """Make processes that are started from now on use this file of profiles and this ROS domain."""
    os.environ.update(FASTRTPS_DEFAULT_PROFILES_FILE=str(file), ROS_DOMAIN_ID=str(domain))


def figures(found: list[Found]) -> list[str]:
    """Return the table's figures for one profile."""
    matched, named = (sorted(column) for column in zip(*found, strict=True))
    return [
        f"{seconds:.3f}"
        for seconds in (
            median(matched),
            matched[min(len(matched) * 9 // 10, len(matched) - 1)],
            matched[-1],
            median(named),
            named[-1],
        )
    ]


if __name__ == "__main__":
    main()
