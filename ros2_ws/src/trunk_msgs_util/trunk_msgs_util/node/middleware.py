"""The middleware's settings for a run, and checks that ROS 2 can use them; a user's own are kept."""

from __future__ import annotations

import os
import re
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import count
from pathlib import Path

from trunk_core.deadline import Deadline, patience
from trunk_core.errors import SettingError, TrunkError

PROFILES = Path(__file__).with_name("fastdds.xml")
PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
SUPER_CLIENT = "ROS_SUPER_CLIENT"  # heeded with a discovery server alone
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
SERVER = "ROS_DISCOVERY_SERVER"
_SHARED_MEMORY = Path("/dev/shm")
# ROS 2's tracing library needs two pages there. Without room for them, loading it kills the process with
# SIGBUS.
_TRACING = ("lttng-ust-wait-*", 2)
_PAGE = os.sysconf("SC_PAGE_SIZE")


class MiddlewareError(TrunkError):
    """The middleware cannot work here: what it lacks, and what to do."""


def prepare(shared_memory: Path = _SHARED_MEMORY) -> None:
    """Point Fast DDS to our profiles, unless the user has settings; call it before rclpy is initialised.

    Processes started one after the other then discover each other sooner, heartbeats are more frequent (the
    next one repairs what was sent to a half-discovered reader, and a node that ends waits for one), and
    messages go by UDP within a host too: shared memory can make a node deaf (fastdds.xml).
    A discovery server is asked for all that it knows: the recorder follows any node, on topics on
    which it has no endpoint itself. No node needs this to meet the others of its run.
    Its name is looked up here, again and again on a bad link: Fast DDS does so once, and where that fails the
    node meets nobody for as long as it runs.

    Raises MiddlewareError if loading ROS 2 would kill the process, or nothing would arrive, and SettingError
    if a setting of the environment cannot be used.
    """
    check_settings()
    if SERVER in os.environ:
        os.environ[SERVER] = ";".join(map(_with_address, os.environ[SERVER].split(";")))
    os.environ.setdefault(SUPER_CLIENT, "TRUE")
    if TRANSPORTS not in os.environ:  # with shared memory alone, nobody could reach us by UDP
        os.environ.setdefault(PROFILES_FILE, str(PROFILES))
        if os.environ[PROFILES_FILE] == str(PROFILES):
            _check_loopback()
    try:
        room = os.statvfs(shared_memory)
    except OSError:
        return  # no shared memory here
    free = room.f_bavail * room.f_frsize
    if free < _PAGE * _tracing_pages(shared_memory):
        raise MiddlewareError(
            f"{shared_memory} is full ({free} bytes free): no ROS 2 process can start; free some of it "
            f"(after a crash: rm {shared_memory}/fastrtps_*), or make it larger (docker run --shm-size)"
        )


def _check_loopback() -> None:
    """Raise MiddlewareError where a host's own processes cannot reach one another by UDP."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(("127.0.0.1", 9))  # sends nothing
    except OSError as error:
        raise MiddlewareError(
            f"no loopback interface ({error.strerror}): nodes of one host cannot reach one another: "
            "ip link set lo up, or start the container with a network"
        ) from None


def _tracing_pages(shared_memory: Path) -> int:
    """Return how many pages ROS 2's tracing still lacks: its files outlive the processes."""
    pattern, pages = _TRACING
    there = sum(path.stat().st_blocks > 0 for path in shared_memory.glob(pattern))
    return max(pages - there, 0)


_NAMED_SERVER = re.compile(r"([\w.-]+)(:\d+)?")  # not TCPv4:[ADDRESS]:PORT, nor [IPv6]:PORT
_LOOK_UP_S = 60.0


def _with_address(server: str) -> str:
    """Return ``HOST:PORT`` with the host's address. Raises SettingError where it has none."""
    match = _NAMED_SERVER.fullmatch(server)
    if match is None:
        return server
    host, port = match[1], match[2] or ""
    deadline = Deadline(_LOOK_UP_S)
    for tries in count():
        try:
            found = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)
            break
        except (socket.gaierror, UnicodeError) as error:
            why = getattr(error, "strerror", None) or str(error)
            no_answer = getattr(error, "errno", None) == socket.EAI_AGAIN
        if not no_answer or deadline.passed:
            raise SettingError(
                f"{SERVER}={os.environ[SERVER]}: {host} has no address ({why}): give the name or the address "
                "of a host that runs scripts/discovery_server.sh, or unset it"
            )
        if not tries:
            program = Path(sys.argv[0]).name
            print(
                f"{program}: waiting for the address of {host} ({SERVER}): {why}", file=sys.stderr
            )
        time.sleep(1.0)
    addresses = {family: str(place[0]) for family, *_, place in reversed(found)}
    if socket.AF_INET in addresses:
        return addresses[socket.AF_INET] + port
    return f"[{addresses[socket.AF_INET6]}]{port}"


_LAST_DOMAIN = 232  # beyond it, DDS has no ports left
_SWITCH = "0", "1"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_FAST_DDS = "rmw_fastrtps"  # what the names of its two variants begin with
_TRANSPORTS = "DEFAULT", "DEFAULTv6", "SHM", "UDPv4", "UDPv6", "LARGE_DATA", "LARGE_DATAv6"
# With another value, ROS 2 ends with a traceback, fills the logs, or goes on as if it had none.
_ALLOWED = {
    _RANGE: ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT"),
    "RCUTILS_COLORIZED_OUTPUT": _SWITCH,
    "RCUTILS_LOGGING_BUFFERED_STREAM": _SWITCH,
    "RCUTILS_LOGGING_USE_STDOUT": _SWITCH,
    "RCL_LOGGING_SPDLOG_EXPERIMENTAL_OLD_FLUSHING_BEHAVIOR": _SWITCH,
}
_SERVER = re.compile(r"^(?:(?:UDP|TCP)v[46]:)?\[?(.*?)\]?(?::(\d{1,9}))?$")  # HOST:PORT
_MIDDLEWARES = "share/ament_index/resource_index/rmw_typesupport"
_LAST_PORT = 65535


def check_settings(environment: Mapping[str, str] = os.environ) -> None:
    """Raise SettingError where ROS 2 would end with a traceback, or its nodes would not find one another."""
    _check_domain(environment.get("ROS_DOMAIN_ID", ""))
    for name, allowed in _ALLOWED.items():
        _check_one_of(name, environment.get(name, ""), allowed)
    _check_middleware(environment)
    if (environment.get("RMW_IMPLEMENTATION") or _FAST_DDS).startswith(_FAST_DDS):
        _check_fast_dds(environment)
    _check_keystore(environment)
    _check_log_folder(environment)
    patience(environment)


def _check_fast_dds(environment: Mapping[str, str]) -> None:
    _check_one_of(TRANSPORTS, environment.get(TRANSPORTS, ""), _TRANSPORTS)
    if environment.get(_RANGE) != "SYSTEM_DEFAULT":  # which does without peers
        for peer in environment.get("ROS_STATIC_PEERS", "").split(";"):
            _check_host("ROS_STATIC_PEERS", peer, peer)
    for server in environment.get(SERVER, "").split(";"):
        host, port = _SERVER.findall(server)[0]
        named = _NAMED_SERVER.fullmatch(server)  # `prepare` looks it up, more patiently
        _check_host(SERVER, server, "" if named else host, int(port or 0))
    _check_profiles(environment.get(PROFILES_FILE, ""))


def _check_domain(text: str) -> None:
    if text and not (text.isascii() and text.isdecimal() and int(text) <= _LAST_DOMAIN):
        raise SettingError(
            f"ROS_DOMAIN_ID={text} is not allowed: a whole number from 0 to {_LAST_DOMAIN}, or unset it"
        )


def _check_one_of(name: str, text: str, allowed: Sequence[str]) -> None:
    if not text or text.partition("?")[0] in allowed:  # a transport's options follow it
        return
    alone = text in ("OFF", "NONE")
    reason = "nodes do not find one another with this value" if alone else "not known"
    raise SettingError(f"{name}={text} is not allowed: {reason}; {', '.join(allowed)}, or unset it")


def _check_middleware(environment: Mapping[str, str]) -> None:
    """Check the middleware's name: rcl ends a process that asks for one that is not there."""
    prefixes = environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    here = {file.name for prefix in prefixes for file in Path(prefix, _MIDDLEWARES).glob("rmw_*")}
    here.discard("rmw_implementation")
    for name in ("RMW_IMPLEMENTATION", "RCL_ASSERT_RMW_ID_MATCHES"):
        text = environment.get(name)
        if text and here and text not in here:
            known = ", ".join(sorted(here))
            raise SettingError(f"{name}={text} is not installed here: {known}, or unset it")


@cache  # a name can take seconds
def _check_host(name: str, text: str, host: str, port: int = 0) -> None:
    try:
        if port > _LAST_PORT:
            raise ValueError(f"ports end at {_LAST_PORT}")
        socket.getaddrinfo(host or None, port, socket.AF_INET if text == host else 0)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise SettingError(
            f"{name}: {text} cannot be used as an address ({why}): correct it, or leave it out"
        ) from None


def _check_profiles(file: str) -> None:
    if not file or file == str(PROFILES):
        return
    from xml.etree import ElementTree

    try:
        ElementTree.parse(file)
    except (OSError, ElementTree.ParseError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise SettingError(
            f"{PROFILES_FILE}={file} cannot be read as XML ({why}): correct or unset it"
        ) from None


def _check_keystore(environment: Mapping[str, str]) -> None:
    """Check what rcl needs where security is enforced."""
    if environment.get("ROS_SECURITY_ENABLE") != "true":
        return
    name = "ROS_SECURITY_KEYSTORE"
    folder = environment.get(name, "")
    if (
        environment.get("ROS_SECURITY_STRATEGY") == "Enforce"
        and not Path(folder, "enclaves").is_dir()
    ):
        raise SettingError(
            f"{name}={folder} has no folder enclaves: set it to a keystore, or unset ROS_SECURITY_ENABLE"
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
