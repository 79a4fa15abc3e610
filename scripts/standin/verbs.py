"""The stand-in's verbs, with the options, outputs and errors of ros2cli in Jazzy.

Other than there, what a node refuses ends with exit code 1. As no daemon knows the graph beforehand, a verb
waits until nothing new is discovered for --spin-time, or until what is named is there.
"""

from __future__ import annotations

import os
import sys
import time
from argparse import ArgumentParser, Namespace
from array import array
from collections import deque
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from importlib import import_module
from itertools import pairwise
from math import inf
from operator import attrgetter
from pathlib import Path
from statistics import fmean, pstdev
from typing import Any

import rclpy
import yaml
from ament_index_python import get_package_prefix, get_packages_with_prefixes
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from numpy import generic
from rcl_interfaces import msg, srv
from rclpy import parameter, qos
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden as is_hidden

from trunk_core.errors import LiveParametersError, TrunkError
from trunk_msgs_util.node import early_signals, middleware
from trunk_runs.live_parameters_node import SET_AGAIN_S, LiveParameters

REAL = "the real one comes with ROS 2 Jazzy: https://docs.ros.org/en/jazzy/Installation.html"
INSTEAD = {"launch": "trunk run SCENARIO", "bag info": "trunk info BAG"}
INSTEAD["bag record"] = "ros2 run trunk_msgs_util recorder"
PATIENCE_S = 5.0
NODE = "--timeout=5.0 node_name"
POLICIES: dict[str, Any] = {"profile": qos.QoSPresetProfiles, "reliability": qos.ReliabilityPolicy}
POLICIES["durability"] = qos.DurabilityPolicy
QOS = "--qos-reliability= --qos-durability= --qos-profile="
VERBS = {  # `=` is before the default of an option, `?` behind what may be left out
    "run": "package_name executable_name",
    "pkg executables": "--full-path package_name?",
    "pkg prefix": "--share package_name",
    "topic list": "-t/--show-types --include-hidden-topics",
    "topic info": "-v/--verbose topic_name",
    "topic echo": f"--once --field= --timeout=.inf {QOS}sensor_data topic_name message_type?",
    "topic hz": "-w/--window=10000 topic_name",
    "topic pub": f"-1/--once -t/--times=0 -r/--rate=1.0 -w/--wait-matching-subscriptions=-1 "
    f"{QOS}default topic_name message_type values",
    "service list": "-t/--show-types -c/--count-services --include-hidden-services",
    "service call": "service_name service_type values?",
    "interface show": "type",
    "param list": f"{NODE}?",
    "param get": f"--hide-type {NODE} parameter_name",
    "param set": f"{NODE} parameter_name value",
    "param dump": NODE,
    "param load": f"--no-use-wildcard {NODE} parameter_file",
    "node list": "-a/--all -c/--count-nodes",
    "node info": "--include-hidden node_name",
    "lifecycle get": f"{NODE}?",
    "lifecycle set": f"{NODE} transition",
}


class Verbs:
    """The verbs, and the graph as a node of this command discovers it, hidden as that of ros2cli."""

    spinning = False  # where an exception would meet rclpy in the middle of a call
    signalled = 0

    def __init__(self, args: Namespace) -> None:
        self.args = args

    @classmethod
    def end(cls, number: int) -> None:
        """End by a signal, at once or when what spins comes back."""
        cls.signalled = number
        if not cls.spinning:
            sys.exit(number)

    @cached_property
    def node(self) -> Any:
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        return rclpy.create_node(f"_ros2cli_{os.getpid()}", start_parameter_services=False)

    def until(self, condition: Callable[[], Any], seconds: float = inf) -> Any:
        """Spin until the condition holds, or for some time; return whether it does."""
        end = time.monotonic() + seconds
        while not (holds := condition()) and time.monotonic() < end:
            Verbs.spinning = True
            rclpy.spin_once(self.node, timeout_sec=0.05)
            Verbs.spinning = False
            if Verbs.signalled:
                sys.exit(Verbs.signalled)
        return holds

    def nodes(self, service: str = "", hidden: bool = False) -> list[str]:
        """Return the full names of all nodes, or of those with a service."""
        known = self.node.get_node_names_and_namespaces()
        names = [f"{s.rstrip('/')}/{n}" for n, s in known if n and (hidden or n[0] != "_")]
        services = dict(self.node.get_service_names_and_types())
        return sorted(name for name in names if not service or f"{name}/{service}" in services)

    def settled(self, service: str = "", hidden: bool = False) -> list[str]:
        """Return the nodes, once --spin-time has brought nothing new."""
        known: Any = None
        while known != (known := (self.nodes(), self.node.get_topic_names_and_types())):
            self.until(lambda: False, self.args.spin_time)
        return self.nodes(service, hidden)

    def asked(self, service: str = "") -> Iterator[tuple[str, LiveParameters]]:
        """Yield the node that is named, or each that has a service, with its name."""
        kinds = srv.SetParameters, ChangeState, GetState, GetAvailableTransitions
        given = self.args.node_name
        for name in [f"/{given.removeprefix('/')}"] if given else self.settled(service):
            with LiveParameters(name, self.args.timeout, *kinds) as node:
                yield name, node

    def topic(self, patience_s: float = 0.0) -> tuple[str, Any]:
        """Return the topic's full name and the class of its messages, once they are known."""
        given, named = self.args.topic_name, getattr(self.args, "message_type", None)
        topic = expand_topic_name(given, self.node.get_name(), "/")

        def types() -> Any:
            return dict(self.node.get_topic_names_and_types()).get(topic)

        if not self.until(types, PATIENCE_S) and not named:
            print(f"WARNING: topic [{given}] does not appear to be published yet")
            if not self.until(types, patience_s):
                raise RuntimeError("Could not determine the type for the passed topic")
        return topic, interface_class(named or types()[0])

    def run(self, args: Namespace) -> None:
        there = " ".join(executables(args.package_name))  # the script starts what is there
        missing = f"no executable '{args.executable_name}' in {args.package_name}"
        raise RuntimeError(f"{missing}; it has: {there}")

    def pkg_executables(self, args: Namespace) -> None:
        given = args.package_name
        for package in [given] if given else sorted(get_packages_with_prefixes()):
            for name, path in executables(package).items():
                print(path if args.full_path else f"{package} {name}")

    def pkg_prefix(self, args: Namespace) -> None:
        executables(args.package_name)
        prefix = get_package_prefix(args.package_name)
        print(f"{prefix}/share/{args.package_name}" if args.share else prefix)

    def topic_list(self, args: Namespace) -> None:
        self.settled()
        for name, types in self.node.get_topic_names_and_types():
            if args.include_hidden_topics or not is_hidden(name):
                print(f"{name} [{', '.join(types)}]" if args.show_types else name)

    def topic_info(self, args: Namespace) -> None:
        self.settled()
        topic = expand_topic_name(args.topic_name, self.node.get_name(), "/")
        types = dict(self.node.get_topic_names_and_types()).get(topic)
        if not types:
            raise RuntimeError(f"Unknown topic '{args.topic_name}'")
        publishers = self.node.get_publishers_info_by_topic(topic)
        subscriptions = self.node.get_subscriptions_info_by_topic(topic)
        lines = [f"Type: {types[0] if len(types) == 1 else types}"]
        for title, ends in ("Publisher", publishers), ("Subscription", subscriptions):
            lines += [f"{title} count: {len(ends)}", *(ends if args.verbose else [])]
        print(*lines, sep=(end := "\n" * (1 + args.verbose)), end=end)

    def service_list(self, args: Namespace) -> None:
        self.settled()
        known = self.node.get_service_names_and_types()
        shown = [(n, t) for n, t in known if args.include_hidden_services or not is_hidden(n)]
        if args.count_services:
            print(len(shown))
            return
        for name, types in shown:
            print(f"{name} [{', '.join(types)}]" if args.show_types else name)

    def service_call(self, args: Namespace) -> int:
        kind = interface_class(args.service_type, "srv", "service")
        request = from_yaml(kind.Request, args.values or "{}")
        client = self.node.create_client(kind, args.service_name)
        if not self.until(client.service_is_ready, PATIENCE_S):
            print("waiting for service to become available...")
            self.until(client.service_is_ready)
        print(f"requester: making request: {request!r}\n")
        future = client.call_async(request)
        self.until(future.done)
        print(f"response:\n{future.result()!r}\n")
        return int(not getattr(future.result(), "success", True))

    def interface_show(self, args: Namespace) -> None:
        print("\n".join(interface_lines(args.type)))

    def topic_echo(self, args: Namespace) -> None:
        topic, kind = self.topic()
        shown: list[str] = []

        def show(message: Any) -> None:
            try:
                value = attrgetter(args.field)(message) if args.field else message
            except AttributeError as error:
                raise RuntimeError(f"Invalid field '{args.field}': {error}") from None
            text = f"{value}\n"
            if hasattr(value, "SLOT_TYPES"):
                layout: Any = {"sort_keys": False, "allow_unicode": True, "width": sys.maxsize}
                text = yaml.dump(plain(value), **layout)
            print(text, end="---\n")
            shown.append(text)

        self.settled()
        publishers = self.node.get_publishers_info_by_topic(topic)
        self.node.create_subscription(kind, topic, show, quality(args, publishers))
        self.until(lambda: args.once and shown, args.timeout)

    def topic_hz(self, args: Namespace) -> None:
        topic, kind = self.topic(inf)
        times: deque[float] = deque(maxlen=max(args.window, 1) + 1)
        profile = qos.qos_profile_sensor_data
        self.node.create_subscription(kind, topic, lambda _: times.append(time.time()), profile)
        self.until(lambda: len(times) > 1)
        while due := times[-1] + 1.0:
            self.until(partial(lambda due: times[-1] >= due, due))
            gaps = [later - earlier for earlier, later in pairwise(times)]
            print(f"average rate: {1.0 / fmean(gaps):.3f}\n\tmin: {min(gaps):.3f}s", end=" ")
            print(f"max: {max(gaps):.3f}s std dev: {pstdev(gaps):.5f}s window: {len(gaps)}")

    def topic_pub(self, args: Namespace) -> None:
        kind, times, count = interface_class(args.message_type), int(args.once) or args.times, 0
        message = from_yaml(kind, args.values)
        publisher = self.node.create_publisher(kind, args.topic_name, quality(args, []))
        wanted = int(times > 0) if (wait := args.wait_matching_subscriptions) < 0 else wait
        while not self.until(lambda: publisher.get_subscription_count() >= wanted, 1.0):
            print(f"Waiting for at least {wanted} matching subscription(s)...")

        def publish() -> None:
            nonlocal count
            count += 1
            print(f"publishing #{count}: {message!r}\n")
            publisher.publish(message)

        self.node.create_timer(1.0 / args.rate, publish)
        print("publisher: beginning loop")
        publish()
        self.until(lambda: 0 < times <= count)
        publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S))

    def param_list(self, args: Namespace) -> None:
        for name, node in self.asked("list_parameters"):
            lines = [
                *[f"{name}:"] * (not args.node_name),
                *(f"  {n}" for n in sorted(node.names())),
            ]
            print(*lines, sep="\n")

    def param_get(self, args: Namespace) -> None:
        for _, node in self.asked():
            values = node.ask(srv.GetParameters, names=[args.parameter_name]).values
            if not values:
                raise RuntimeError("Parameter not set")
            kind = parameter.Parameter.Type(values[0].type).name.capitalize()
            label = f"{kind.replace('Bool', 'Boolean')} value is: "
            label = "" if args.hide_type else label.replace("_array value is", " values are")
            print(label + str(parameter.parameter_value_to_python(values[0])))

    def param_dump(self, _: Namespace) -> None:
        for node_name, node in self.asked():
            tree: dict[str, Any] = {}
            for name, value in node.values(sorted(node.names())).items():
                *above, last = name.split(".")
                branch = tree
                for part in above:
                    branch = branch.setdefault(part, {})
                branch[last] = value
            print(yaml.dump({node_name: {"ros__parameters": tree}}, default_flow_style=False))

    def set_all(self, parameters: list[Any], good: str, bad: str) -> int:
        """Set parameters one by one; return 1 if any is refused."""
        if long := [p.name for p in parameters if not -(2**63) <= p.value.integer_value < 2**63]:
            raise RuntimeError(f"{long[0]}: an integer beyond 64 bits")
        results: list[Any] = []
        for _, node in self.asked():
            results = node.ask(srv.SetParameters, SET_AGAIN_S, parameters=parameters).results
        for given, result in zip(parameters, results, strict=True):
            done, reason = result.successful, result.reason and f": {result.reason}"
            text = (good if done else bad).format(given.name) + reason
            print(text, file=sys.stdout if done else sys.stderr)
        return int(not all(result.successful for result in results))

    def param_set(self, args: Namespace) -> int:
        value = parameter.get_parameter_value(args.value)
        given = msg.Parameter(name=args.parameter_name, value=value)
        return self.set_all([given], "Set parameter successful", "Setting parameter failed")

    def param_load(self, args: Namespace) -> int:
        wild = not args.no_use_wildcard
        given = parameter.parameter_dict_from_yaml_file(args.parameter_file, wild).values()
        return self.set_all([*given], "Set parameter {} successful", "Set parameter {} failed")

    def node_list(self, args: Namespace) -> None:
        names = self.settled(hidden=args.all)
        print(len(names) if args.count_nodes else "\n".join(names))

    def node_info(self, args: Namespace) -> None:
        from rclpy import action  # slow to load

        if args.node_name not in self.settled(hidden=args.include_hidden):
            raise RuntimeError(f"Unable to find node '{args.node_name}'")
        print(args.node_name)
        space, _, name = args.node_name.rpartition("/")
        for of in (
            "subscriber",
            "publisher",
            "service",
            "client",
            "action_server",
            "action_client",
        ):
            title = {"service": "service server", "client": "service client"}.get(of, of)
            listed = getattr(action if "_" in of else Node, f"get_{of}_names_and_types_by_node")
            there = [(n, t) for n, t in listed(self.node, name, space or "/")]
            lines = [
                f"    {n}: {', '.join(t)}"
                for n, t in there
                if args.include_hidden or not is_hidden(n)
            ]
            print(f"  {title.replace('_', ' ').title()}s:", "\n".join(lines), sep="\n")

    def lifecycle_get(self, args: Namespace) -> None:
        for name, node in self.asked("get_state"):
            state = node.ask(GetState).current_state
            print(f"{name}: " * (not args.node_name) + f"{state.label} [{state.id}]")

    def lifecycle_set(self, args: Namespace) -> None:
        for _, node in self.asked():
            known = [t.transition for t in node.ask(GetAvailableTransitions).available_transitions]
            named = [t for t in known if args.transition in (t.label, str(t.id))]
            if not named:
                lines = "".join(f"\n- {t.label} [{t.id}]" for t in known)
                raise RuntimeError(f"Unknown transition requested, available ones are:{lines}")
            node.timeout_s = inf  # for it is asked once alone
            if not node.ask(ChangeState, 1e9, transition=named[0]).success:
                raise RuntimeError("Transitioning failed")
            print("Transitioning successful")


def executables(package: str) -> dict[str, Path]:
    """Return the executables of a package by name. Raises RuntimeError where there is no such package."""
    if package not in (known := get_packages_with_prefixes()):
        there = " ".join(name for name in sorted(known) if executables(name))
        raise RuntimeError(f"package '{package}' not found; packages with executables: {there}")
    files = sorted(Path(known[package], "lib", package).glob("*"))
    return {path.name: path for path in files if path.is_file() and os.access(path, os.X_OK)}


def interface_class(name: str, folder: str = "msg", kind: str = "message") -> Any:
    package, _, last = name.replace(f"/{folder}/", "/").partition("/")
    try:
        return getattr(import_module(f"{package}.{folder}"), last)
    except (AttributeError, ImportError, TypeError):
        raise RuntimeError(f"The passed {kind} type is invalid") from None


def interface_lines(name: str, edge: str = "") -> Iterator[str]:
    """Yield an interface's lines, and below a field of another message that one's, without comments."""
    try:
        package, *folder, last = name.split("/")
        share = Path(get_package_prefix(package), "share", package, *(folder or ["msg"]))
        path = next(
            file for end in (".msg", ".srv", ".action") if (file := share / (last + end)).exists()
        )
    except (LookupError, StopIteration, ValueError):
        raise RuntimeError(f"Could not find the interface '{name}'") from None
    for line in path.read_text(encoding="utf-8").rstrip().splitlines():
        code = line.partition("#")[0].rstrip()
        if code or not edge:
            yield edge + (code if edge else line.rstrip())
        kind = code.partition(" ")[0].partition("[")[0]
        if "/" in kind or kind[:1].isupper():
            yield from interface_lines(kind if "/" in kind else f"{package}/{kind}", edge + "\t")


def plain(value: Any) -> Any:
    """Return a message as dicts, lists and numbers."""
    if hasattr(value, "SLOT_TYPES"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    value = value.decode("latin-1") if isinstance(value, bytes) else value
    if isinstance(value, bool | int | float | str) and not isinstance(value, generic):
        return value
    return value.item() if isinstance(value, generic) else [plain(item) for item in value]


def from_yaml(kind: Any, text: str) -> Any:
    """Return a message with the fields that a text gives. Raises RuntimeError."""
    if not isinstance(values := yaml.safe_load(text), dict):
        raise RuntimeError("The passed value needs to be a dictionary in YAML format")
    try:
        return filled(kind, values)
    except (AssertionError, AttributeError, TypeError, ValueError, OverflowError) as error:
        raise RuntimeError(f"Failed to populate field: {error}") from None


def filled(kind: Any, values: Any) -> Any:
    """Return a message with these fields; what it does not have or take raises one of many exceptions."""
    message = kind()
    for name, given in values.items():
        field = getattr(message, name)
        if hasattr(field, "SLOT_TYPES"):
            given = filled(type(field), given)
        elif isinstance(field, array):
            given = array(field.typecode, given)
        elif isinstance(field, bool | int | float | str):
            given = type(field)(given)
        setattr(message, name, given)
    return message


def quality(args: Namespace, publishers: list[Any]) -> Any:
    """Return the QoS that is asked for; the rest of it fits the publishers."""
    profile = qos.QoSPresetProfiles[args.qos_profile.upper()].value
    for name in ("reliability", "durability"):
        policy, given = POLICIES[name], getattr(args, f"qos_{name}")
        if given:
            setattr(profile, name, policy[given.upper()])
        elif publishers:  # of 1 and 2, the second is offered by both
            values = [getattr(publisher.qos_profile, name) for publisher in publishers]
            setattr(profile, name, policy(max(values)))
    return profile


def parsed(verb: str, words: list[str]) -> Namespace:
    parser = ArgumentParser(prog=f"ros2 {verb}", usage=f"ros2 {verb} {VERBS[verb]}")
    ends = partial(parser.exit, 2)
    parser.error = lambda why: ends(f"{parser.prog}: error: {why}; it takes {VERBS[verb]}\n")
    for word in f"{VERBS[verb]} --spin-time=0.75 --no-daemon".split():
        names, valued, text = word.partition("=")
        default = yaml.safe_load(text) if text else ""
        how: Any = (
            {"default": default, "type": type(default)} if valued else {"action": "store_true"}
        )
        if not word.startswith("-"):
            how = {"nargs": "?"} if word.endswith("?") else {}
        if policy := POLICIES.get(names.removeprefix("--qos-")):
            how["choices"] = policy.short_keys()
        parser.add_argument(*names.rstrip("?").split("/"), **how)
    args = parser.parse_args(words)
    if not getattr(args, "rate", 1.0) > 0.0:
        parser.error(f"argument -r/--rate: it must be positive: {args.rate:g}")
    return args


def main(words: list[str]) -> Any:
    """Do what a verb does; return its exit code, or what is wrong."""
    early_signals.end_by(Verbs.end)
    count = 1 if words[:1] == ["run"] else 2
    verb = " ".join(words[:count])
    there = [name for name in VERBS if name.split()[:1] == words[:1]]
    if verb not in VERBS:
        if not words[len(there) > 0 :] or words[-1] in ("-h", "--help"):
            return print(*(f"ros2 {name} {VERBS[name]}" for name in there or VERBS), REAL, sep="\n")
        other = INSTEAD.get(verb) or INSTEAD.get(words[0])
        instead = f": {other} does it" if other else ""
        known = f"the stand-in has {', '.join(there or VERBS)}; {REAL}"
        print(f"ros2 (stand-in): no '{verb}' here{instead}; {known}", file=sys.stderr)
        return 2
    args = parsed(verb, words[count : 3 if count == 1 else None])
    try:
        middleware.prepare()
        return getattr(Verbs(args), verb.replace(" ", "_"))(args)
    except BrokenPipeError:  # whoever read has left
        return 141
    except (RuntimeError, TrunkError, OSError, ValueError, LookupError, yaml.YAMLError) as error:
        absent = "Node not found: " if isinstance(error, LiveParametersError) else ""
        if isinstance(error, OSError) and error.filename is None:
            absent = "standard output: "
        return absent + " ".join(str(error).split())
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
