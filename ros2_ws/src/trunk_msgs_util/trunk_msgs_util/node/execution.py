"""A process that runs nodes: one line for a user's mistake at the start, an executor, and an orderly end.

The executor is single-threaded, and quick for the messages of a control loop. rclpy's own collects all
entities and builds a new wait set for each callback, which costs more than the callback itself. This one
takes messages and calls timers directly, waits on a set that it builds once, and leaves everything else
(services, guard conditions, events of the middleware) to rclpy, so that it behaves as usual. A node has
dozens of these, and each makes a wait longer: for some time after a message it waits without them.
"""

from __future__ import annotations

import inspect
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
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.utilities import remove_ros_args
from rclpy.waitable import NumberOfEntities

from trunk_core.errors import EXIT_FAILED, EXIT_USAGE, TrunkError
from trunk_core.parameters.declarations import of_every_node, table_of, unknown_name
from trunk_core.parameters.parameter_files import ParameterFileError, read
from trunk_core.text import bounded, printable

from . import middleware
from .base import TrunkNode
from .early_signals import Interrupt

# While messages keep coming, this is how often timers get their turn, and services and everything else.
_TIMERS_EVERY_NS = 2_000_000
_OTHERS_EVERY_NS = 20_000_000
# Messages taken from one subscription before the next one's turn.
_BURST = 64
# A subscription without a message this many times in a row (events, references) is polled only once in as
# many turns while other messages keep coming. A wait covers all subscriptions.
_RARE = 16


class LoopExecutor(SingleThreadedExecutor):
    """Runs callbacks in the thread that calls ``spin_once``; messages first, in their order per topic."""

    def __init__(self, linger_s: Callable[[], float] = lambda: 0.0, **arguments: Any) -> None:
        """Create it; ``linger_s`` says how long, in s, messages collect before they are taken."""
        super().__init__(**arguments)
        self._linger_s = linger_s
        self._subscriptions: list[Subscription] = []
        self._with_info: list[bool] = []
        self._in_vain: list[int] = []  # turns without a message
        self._turn = 0
        self._timers: list[Timer] = []
        self._wait_set: Any = None
        self._known = -1
        self._timers_due_ns = 0
        self._others_due_ns = 0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Handle what is ready, or wait for it for at most ``timeout_sec`` s (None: forever)."""
        if self._wait_set is None:
            self._collect()
        self._turn += 1
        taken = self._take_messages(rare_ones=self._turn % _RARE == 0)
        now_ns = time.monotonic_ns()
        if now_ns >= self._timers_due_ns:
            self._call_timers()
        if taken:
            if now_ns >= self._others_due_ns:
                self._others()
            return
        left_ns = self._others_due_ns - now_ns
        for_all = left_ns <= 0
        limit_ns = -1 if timeout_sec is None else round(timeout_sec * 1e9)
        if not for_all and not 0 <= limit_ns < left_ns:
            limit_ns = left_ns
        others = self._wait(limit_ns, for_all)
        if for_all and not others:
            self._others_due_ns = time.monotonic_ns() + _OTHERS_EVERY_NS
        self._take_messages(rare_ones=True)
        self._call_timers()
        if others:
            self._others()
            self._others_due_ns = 0  # one was handled: there may be more

    def _others(self) -> None:
        super().spin_once(0.0)
        self._collect()
        self._others_due_ns = time.monotonic_ns() + _OTHERS_EVERY_NS

    def _collect(self) -> None:
        """Look up the nodes' entities again if any was created or destroyed."""
        nodes = self.get_nodes()
        subscriptions = [s for node in nodes for s in node.subscriptions]
        timers = [t for node in nodes for t in node.timers]
        services = [s for node in nodes for s in node.services]
        guards = [*(g for node in nodes for g in node.guards), self._guard]
        waitables = [w for node in nodes for w in node.waitables]
        entities = (*subscriptions, *timers, *services, *guards, *waitables)
        known = hash(tuple(id(e) for e in entities))
        if known == self._known:
            return
        self._known = known
        self._cb_iter = None  # rclpy would go on by places in an outdated wait set
        self._subscriptions = subscriptions
        self._with_info = [wants_info(s.callback) for s in subscriptions]
        self._in_vain = [0] * len(subscriptions)
        self._timers, self._services, self._guards = timers, services, guards
        self._waitables = waitables
        count = sum(
            (waitable.get_num_entities() for waitable in waitables),
            NumberOfEntities(len(subscriptions), len(guards), len(timers), 0, len(services)),
        )
        self._wait_set = _rclpy.WaitSet(
            count.num_subscriptions,
            count.num_guard_conditions,
            count.num_timers,
            count.num_clients,
            count.num_services,
            count.num_events,
            self._context.handle,
        )

    def _take_messages(self, rare_ones: bool) -> bool:
        taken = False
        in_vain = self._in_vain
        for i, subscription in enumerate(self._subscriptions):
            if in_vain[i] > _RARE and not rare_ones:
                continue
            handle, callback = subscription.handle, subscription.callback
            with_info = self._with_info[i]
            in_vain[i] += 1
            for _ in range(_BURST):
                message = handle.take_message(subscription.msg_type, subscription.raw)
                if message is None:
                    break
                taken, in_vain[i] = True, 0
                if with_info:
                    callback(*message)
                else:
                    callback(message[0])
        return taken

    def _call_timers(self) -> None:
        self._timers_due_ns = time.monotonic_ns() + _TIMERS_EVERY_NS
        for timer in self._timers:
            try:
                if not timer.is_ready():
                    continue
                timer.handle.call_timer()
            except InvalidHandle:  # another callback has destroyed it
                continue
            timer.callback()

    def _fill_wait_set(self, for_all: bool) -> None:
        wait_set = self._wait_set
        wait_set.clear_entities()
        for subscription in self._subscriptions:
            wait_set.add_subscription(subscription.handle)
        for timer in self._timers:
            wait_set.add_timer(timer.handle)
        for guard in self._guards:
            wait_set.add_guard_condition(guard.handle)
        if for_all:
            for service in self._services:
                wait_set.add_service(service.handle)
            for waitable in self._waitables:
                waitable.add_to_wait_set(wait_set)

    def _wait(self, limit_ns: int, for_all: bool) -> bool:
        """Wait, including services and events only if ``for_all``; a ``limit_ns`` below 0 is no limit.

        Return True if something other than a message or a timer is ready.
        """
        try:
            self._fill_wait_set(for_all)
        except (InvalidHandle, _rclpy.RCLError):  # a callback has destroyed something
            self._collect()
            self._fill_wait_set(for_all)
        wait_set = self._wait_set
        wait_set.wait(limit_ns)
        linger_s = self._linger_s()
        if linger_s and wait_set.get_ready_entities("subscription"):
            time.sleep(linger_s)
        triggered = wait_set.get_ready_entities("guard_condition")
        for guard in self._guards:
            if guard.handle.pointer in triggered and guard is not self._guard:
                guard.trigger()  # the wait has cleared it, and rclpy is still to see it
        if triggered or wait_set.get_ready_entities("service"):
            return True
        return for_all and any(waitable.is_ready(wait_set) for waitable in self._waitables)


def wants_info(callback: Callable[..., Any]) -> bool:
    """Return True for a callback that also takes the message's information, by rclpy's own rule."""
    try:
        inspect.signature(callback).bind(object())
    except TypeError:
        return True
    return False


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
    # rcl would print its own version of what our one line says.
    set_logger_level("rcl", LoggingSeverity.FATAL)
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
