"""Environment settings that ROS 2 cannot use are named, with what is allowed."""

from __future__ import annotations

import errno
import os
import socket

import pytest

from trunk_msgs_util.node.middleware import (
    PROFILES_FILE,
    MiddlewareError,
    SettingError,
    check_settings,
    patience,
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
    ],
)
def test_what_ros_can_use_is_accepted(home, settings):
    check_settings(home | settings)


@pytest.mark.parametrize("domain", ["abc", "-1", "1.5", "233", "99999999999999999999", "²", " 1"])
def test_a_domain_that_does_not_exist(home, domain):
    with pytest.raises(SettingError, match="is not allowed: a whole number from 0 to 232") as error:
        check_settings(home | {"ROS_DOMAIN_ID": domain})
    assert str(error.value).startswith(f"ROS_DOMAIN_ID={domain} ")


@pytest.mark.parametrize(
    ("value", "why"), [("OFF", "do not find one another"), ("off", "not known")]
)
def test_a_range_in_which_no_node_is_found(home, value, why):
    with pytest.raises(
        SettingError, match=f"^ROS_AUTOMATIC_DISCOVERY_RANGE={value} .*{why}.*LOCALHOST"
    ):
        check_settings(home | {"ROS_AUTOMATIC_DISCOVERY_RANGE": value})


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


def test_the_patience_of_nodes_that_end():
    assert [patience({}), patience({"TRUNK_PATIENCE": "2.5"})] == [1.0, 2.5]
