"""Environment settings that ROS 2 cannot use are named, with what is allowed."""

import errno
import os
import re
import socket

import pytest

from trunk_core.errors import SettingError
from trunk_msgs_util.node import middleware
from trunk_msgs_util.node.middleware import (
    PROFILES,
    PROFILES_FILE,
    MiddlewareError,
    check_settings,
    prepare,
)


@pytest.fixture
def home(tmp_path):
    return {"HOME": str(tmp_path)}


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"ROS_DOMAIN_ID": ""},
        {"ROS_DOMAIN_ID": "0"},
        {"ROS_DOMAIN_ID": "232", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"},
        {"ROS_STATIC_PEERS": "127.0.0.1;localhost;", "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        {"ROS_DISCOVERY_SERVER": ";localhost;127.0.0.1:11811;[::1]:11811;TCPv4:[127.0.0.1]:42100"},
        {
            "FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA?max_msg_size=1MB",
            "RCUTILS_COLORIZED_OUTPUT": "",
        },
        {"FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILES)},
        {"ROS_SECURITY_ENABLE": "true"},
    ],
)
def test_what_ros_can_use_is_accepted(home, settings):
    check_settings(home | settings)


@pytest.mark.parametrize("domain", ["abc", "-1", "1.5", "233", "99999999999999999999", "²", " 1"])
def test_a_domain_that_does_not_exist(home, domain):
    with pytest.raises(SettingError, match="is not allowed: a whole number from 0 to 232") as error:
        check_settings(home | {"ROS_DOMAIN_ID": domain})
    assert str(error.value).startswith(f"ROS_DOMAIN_ID={domain} ")


_BAD = {  # of each setting, a value that ROS 2 cannot use and what is said of it
    "ROS_AUTOMATIC_DISCOVERY_RANGE": [
        ("OFF", "not allowed: nodes do not find one another with this value; SUBNET, LOCALHOST"),
        ("off", "not allowed: not known; SUBNET, LOCALHOST"),
    ],
    "FASTDDS_BUILTIN_TRANSPORTS": [
        ("NONE", "not allowed: nodes do not find one another"),
        ("udp", "not allowed: not known; DEFAULT"),
    ],
    "RCUTILS_COLORIZED_OUTPUT": [("yes", "not allowed: not known; 0, 1")],
    "RCUTILS_LOGGING_BUFFERED_STREAM": [("yes", "not allowed: not known; 0, 1")],
    "RCUTILS_LOGGING_USE_STDOUT": [("yes", "not allowed: not known; 0, 1")],
    "RCL_LOGGING_SPDLOG_EXPERIMENTAL_OLD_FLUSHING_BEHAVIOR": [
        ("x", "not allowed: not known; 0, 1")
    ],
    "RMW_IMPLEMENTATION": [("rmw_of_another_machine", "not installed here: rmw_ours, or unset it")],
    "RCL_ASSERT_RMW_ID_MATCHES": [("rmw_other", "not installed here: rmw_ours, or unset it")],
    "ROS_STATIC_PEERS": [
        ("robot.invalid", "robot.invalid cannot be used as an address ("),
        ("127.0.0.1;::1", "::1 cannot be used as an address"),
    ],
    "ROS_DISCOVERY_SERVER": [
        ("UDPv4:[1.2.3.4.5]:99", "UDPv4:[1.2.3.4.5]:99 cannot be used as an address ("),
        ("127.0.0.1:99999", "127.0.0.1:99999 cannot be used as an address (ports end at 65535)"),
    ],
    "FASTRTPS_DEFAULT_PROFILES_FILE": [
        ("/nowhere.xml", "cannot be read as XML (No such file or directory): correct or unset it"),
        (__file__, "cannot be read as XML (not well-formed"),
    ],
    "ROS_SECURITY_KEYSTORE": [("/nowhere", "has no folder enclaves: set it to a keystore, or")],
}


@pytest.mark.parametrize(
    ("name", "value", "says"), [(name, *row) for name, rows in _BAD.items() for row in rows]
)
def test_a_setting_that_ros_cannot_use_is_named(home, tmp_path, name, value, says):
    installed = tmp_path / "share/ament_index/resource_index/rmw_typesupport"
    installed.mkdir(parents=True)
    for name_of_rmw in ("rmw_ours", "rmw_implementation"):
        (installed / name_of_rmw).touch()
    enforced = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
    more = enforced if "SECURITY" in name else {}
    with pytest.raises(SettingError, match=f"^{name}\\b.*{re.escape(says)}"):
        check_settings(home | more | {"AMENT_PREFIX_PATH": str(tmp_path), name: value})


@pytest.mark.parametrize("name", ["HOME", "ROS_HOME", "ROS_LOG_DIR"])
def test_a_log_folder_that_cannot_be_made_is_named_by_its_setting(home, tmp_path, name):
    (tmp_path / "file").touch()
    with pytest.raises(SettingError, match=f"^{name}=.*file: no logs can be written.*ROS_LOG_DIR"):
        check_settings(home | {name: str(tmp_path / "file")})


def test_logs_that_go_elsewhere_need_no_home(tmp_path):
    check_settings({"HOME": "/proc/none", "ROS_LOG_DIR": str(tmp_path / "logs")})
    with pytest.raises(SettingError, match="neither ROS_LOG_DIR nor HOME is set"):
        check_settings({})


@pytest.mark.parametrize("factor", ["abc", "0", "-1", "inf", "nan", "1_0", "\uff11"])
def test_a_patience_that_is_not_a_factor(home, factor):
    with pytest.raises(SettingError, match=f"^TRUNK_PATIENCE={factor} is not allowed: a factor"):
        check_settings(home | {"TRUNK_PATIENCE": factor})


def test_a_host_that_cannot_reach_itself_is_named(monkeypatch, home, tmp_path):
    def unreachable(*_: object) -> None:
        raise OSError(errno.ENETUNREACH, os.strerror(errno.ENETUNREACH))

    monkeypatch.setattr(os, "environ", dict(home))
    prepare(tmp_path)
    monkeypatch.setattr(socket.socket, "connect", unreachable)
    with pytest.raises(
        MiddlewareError, match=r"^no loopback interface \(Network is unreachable\): nodes of one"
    ):
        prepare(tmp_path)
    monkeypatch.setattr(os, "environ", home | {PROFILES_FILE: "my.xml"})
    prepare(tmp_path)  # it may use shared memory


@pytest.fixture
def answers(monkeypatch):
    """What the look-ups of names give, one after the other; how they fail: an error's number."""
    given = []

    def look_up(host, *_, **__):
        if not host.isalpha():  # no name
            return []
        answer = given.pop(0)
        if isinstance(answer, int):
            raise socket.gaierror(answer, "it does not resolve")
        return [(family, 2, 17, "", (address, 0)) for family, address in answer]

    monkeypatch.setattr(os, "environ", {**os.environ})  # `prepare` sets more than one
    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    monkeypatch.setattr(middleware.time, "sleep", lambda _: None)
    return given


V4, V6 = (socket.AF_INET, "10.0.0.7"), (socket.AF_INET6, "fd00::7")


@pytest.mark.parametrize(
    ("server", "given", "used"),
    [
        ("robot:11811", [[V6, V4]], "10.0.0.7:11811"),
        ("robot", [[V4]], "10.0.0.7"),
        ("robot:11811", [[V6]], "[fd00::7]:11811"),
        (";robot:11811;UDPv4:[10.0.0.9]:11811", [[V4]], ";10.0.0.7:11811;UDPv4:[10.0.0.9]:11811"),
        ("[fd00::9]:11811", [], "[fd00::9]:11811"),
    ],
)
def test_a_discovery_server_is_given_by_address(answers, server, given, used):
    os.environ["ROS_DISCOVERY_SERVER"] = server
    answers += given
    prepare()
    assert os.environ["ROS_DISCOVERY_SERVER"] == used


def test_a_name_is_looked_up_until_the_link_is_good(answers, capsys):
    os.environ["ROS_DISCOVERY_SERVER"] = "robot:11811"
    answers += [socket.EAI_AGAIN, socket.EAI_AGAIN, [V4]]
    prepare()
    (said,) = capsys.readouterr().err.splitlines()
    assert "waiting for the address of robot (ROS_DISCOVERY_SERVER): it does not" in said
    assert os.environ["ROS_DISCOVERY_SERVER"] == "10.0.0.7:11811"


def test_a_server_that_does_not_exist_is_named(answers):
    os.environ["ROS_DISCOVERY_SERVER"] = "robot:11811"
    answers += [socket.EAI_NONAME]
    with pytest.raises(
        SettingError, match=r"^ROS_DISCOVERY_SERVER=robot:11811: robot has no address"
    ):
        prepare()
