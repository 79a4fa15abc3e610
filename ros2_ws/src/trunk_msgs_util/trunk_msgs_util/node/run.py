"""A process that runs nodes: one line for a user's mistake at the start, and an orderly end."""

from __future__ import annotations

import re
import sys
import time
import traceback
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ..errors import EXIT_FAILED, EXIT_USAGE, TrunkError
from ..parameters.declarations import of_every_node, table_of, unknown_name
from ..parameters.files import ParameterFileError, read
from ..text import bounded, printable
from . import middleware
from .base import TrunkNode
from .early_signals import Interrupt
from .executor import LoopExecutor

Beside = TypeVar("Beside", bound=Node)
_SETTING = re.compile(r"(?:([^:]+):)?([^:]+):=.*", re.DOTALL)  # [NODE:]NAME:=VALUE
_PLAN = "start the nodes that trunk plan names, or plan anew"
_DRAIN_S = 5.0  # at most, while messages still arrive; with none arriving, the nodes end at once


class ArgumentError(TrunkError):
    """An argument of a node's command line that nothing uses: which one, and what to write."""


def run_nodes(
    creators: Mapping[str, Callable[[], TrunkNode[Any]]],
    program: str,
    argv: Sequence[str] | None = None,
) -> int:
    """Run nodes in one executor until one of them is done, or they are told to stop.

    Return the process's exit code: 0 after a finished run, and after SIGINT or SIGTERM unless a node was to
    see a run through to its end; 1 if it was, if a node failed or if a callback raised; 2, with one line on
    stderr and no traceback, if a parameter or an argument is wrong.
    Whatever happens, the nodes are closed in the reverse order of the mapping: the recorder comes first in
    it, so that it closes last and what it has recorded is kept. ``argv``: by default the
    process's.
    """
    argv = sys.argv if argv is None else argv
    interrupt = Interrupt()
    try:
        _initialize(program, argv, [name for name in creators if name != program])
    except (TrunkError, RuntimeError, ValueError) as error:
        return _say(program, error, getattr(error, "exit_code", EXIT_USAGE))
    nodes: list[TrunkNode[Any]] = []
    try:
        for name, create in creators.items():
            program = name
            nodes.append(create())
            if len(nodes) == len(creators):
                _check_settings(nodes, argv)
                _check_plans(nodes, argv)
            nodes[-1].autostart()
    except TrunkError as error:
        _close(nodes)
        return _say(program, error, error.exit_code)
    except Exception as error:  # a defect of ours
        _fail(nodes, error)
        _end(nodes, LoopExecutor())
        interrupt.ignore()
        return EXIT_FAILED
    executor = LoopExecutor(lambda: min(node.linger_s for node in nodes))
    for node in nodes:
        executor.add_node(node)
    try:
        while not interrupt.name and all(node.exit_code is None for node in nodes):
            executor.spin_once(timeout_sec=0.1)
    except ExternalShutdownException:
        pass
    except Exception as error:  # a defect of ours
        _fail(nodes, error)
    _end(nodes, executor)
    interrupt.ignore()
    return max(node.exit_code or (EXIT_FAILED if node.unfinished else 0) for node in nodes)


def run_beside(
    create: Callable[[], Beside], turn: Callable[[Beside, LoopExecutor], None], program: str
) -> int:
    """Run a node that takes no part in a run, ``turn`` by turn, until it is told to stop.

    Return the process's exit code, as `run_nodes` does.
    """
    interrupt = Interrupt()
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        try:
            _initialize(program, sys.argv)
            node = create()
            stack.callback(node.destroy_node)
            _check_settings([node], sys.argv)
        except (TrunkError, RuntimeError, ValueError) as error:
            return _say(program, error, getattr(error, "exit_code", EXIT_USAGE))
        executor = LoopExecutor()
        executor.add_node(node)
        while not interrupt.name:
            turn(node, executor)
        executor.shutdown()
    interrupt.ignore()
    return 0


def _initialize(program: str, argv: Sequence[str], own: Collection[str] = ()) -> None:
    """Initialize rclpy from the command line, whose only arguments besides ROS 2's are ``own``.

    Raises TrunkError, and RuntimeError or ValueError (RCLError and kin) for what ROS 2 refuses.
    """
    middleware.prepare()
    unused = [word for word in remove_ros_args(argv)[1:] if word not in own]
    if {"-h", "--help"} & set(unused):
        print(
            f"usage: {program} --ros-args [-p NAME:=VALUE] [--params-file FILE] [-r OLD:=NEW] "
            "(trunk params lists the parameters)"
        )
        sys.exit(0)
    if unused:
        begin = argv.index("--ros-args") if "--ros-args" in argv else len(argv)
        before = " ".join(word for word in argv[1:begin] if word not in own) or " ".join(unused)
        advice = "leave it out"
        if any(word.startswith("-") or ":=" in word for word in unused):
            after = " ".join(["--ros-args", before, *argv[begin + 1 :]])
            advice = f"arguments for ROS 2 follow --ros-args: {after}"
        raise ArgumentError(f"nothing uses {before}: {advice}")
    # rcl would print its own version of what our one line says.
    set_logger_level("rcl", LoggingSeverity.FATAL)
    rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)


def _check_settings(nodes: Sequence[Node], argv: Sequence[str]) -> None:
    """Raise ArgumentError for a ``-p`` that sets a parameter which no node of this process has."""
    for flag, word in pairwise(argv):
        setting = _SETTING.fullmatch(word) if flag in ("-p", "--param") else None
        if setting is None or of_every_node(setting[2]):
            continue
        named = [node for node in nodes if setting[1] in (None, node.get_name())]
        if not named:
            names = ", ".join(node.get_name() for node in nodes)
            raise ArgumentError(f"nothing uses -p {word}: it is for {setting[1]}, this is {names}")
        known = [name for node in named for name in node.get_parameters_by_prefix("")]
        if setting[2] not in known and not table_of(setting[2], known):
            raise ArgumentError(f"nothing uses -p {word}: {unknown_name(setting[2], known)}")


def _check_plans(nodes: Sequence[Node], argv: Sequence[str]) -> None:
    """Raise ArgumentError for the file of a plan that lacks a node: its defaults are not what was planned."""
    for path in (word for flag, word in pairwise(argv) if flag == "--params-file"):
        try:
            sections = read(Path(path)).sections
        except ParameterFileError:  # written by hand: only rcl has to read it
            continue
        lists = (s.values.get("controllers") for s in sections if s.last_token == "recorder")
        planned = next((names for names in lists if isinstance(names, list)), ())
        for name in (node.get_fully_qualified_name() for node in nodes):
            if planned and not any(section.matches(name) for section in sections):
                there = ", ".join(map(str, planned))
                raise ArgumentError(f"{path}: the plan is for {there}, it has no {name}: {_PLAN}")


def _fail(nodes: list[TrunkNode[Any]], error: Exception) -> None:
    """Print a defect in full on stderr; the recording and the nodes' logs get its last line."""
    traceback.print_exception(error)
    for node in nodes:
        if node.exit_code is None:
            node.fail(f"a callback raised {type(error).__name__}: {error}")


def _end(nodes: list[TrunkNode[Any]], executor: LoopExecutor) -> None:
    for node in reversed(nodes):
        node.end()
    deadline = time.monotonic() + _DRAIN_S
    _drain(nodes, executor, deadline)
    if len(nodes) > 1:  # a recorder among them takes in the others' counts, too, before it closes
        for node in nodes:
            node.account()
        _drain(nodes, executor, deadline)
    executor.shutdown()
    _close(nodes)


def _drain(nodes: list[TrunkNode[Any]], executor: LoopExecutor, deadline: float) -> None:
    """Let nodes take the messages in flight to them, until none expects more."""
    while any(node.draining() for node in nodes) and time.monotonic() < deadline:
        try:
            executor.spin_once(timeout_sec=0.02)
        except Exception:
            traceback.print_exc()  # and handle the remaining messages


def _close(nodes: list[TrunkNode[Any]]) -> None:
    """Close every node, the last one first, even if closing another one raises."""
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        for node in nodes:
            stack.callback(node.close)


def _say(name: str, error: Exception, exit_code: int) -> int:
    line = bounded(printable(" ".join(str(error).split())))
    print(f"{name}: error: {line}", file=sys.stderr, flush=True)
    return exit_code


def main_for(create: Callable[[], TrunkNode[Any]], name: str) -> Callable[[], None]:
    """Return the ``main`` of a node's executable."""

    def main() -> None:
        sys.exit(run_nodes({name: create}, name))

    return main
