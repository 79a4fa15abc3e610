"""The stand-in for `ros2` on real nodes answers as ros2cli, whose texts are written out here."""

import signal
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from .peer import Peer
from .processes import PATIENT, Child, Children
from .services import Services
from .test_param_dump import dump

pytestmark = pytest.mark.graph

ROS2 = Path(__file__).parents[2] / "scripts/standin/ros2"
KIND = "sensor_msgs/msg/JointState"
Start = Callable[..., Child]
Ros2 = Callable[..., tuple[int, str, str]]


@pytest.fixture
def start(children: Children) -> Start:
    numbers = count()
    return lambda *words: children.start(f"ros2-{next(numbers)}", ROS2, *words)


@pytest.fixture
def ros2(start: Start) -> Ros2:
    def run(*words: object) -> tuple[int, str, str]:
        child = start(*words)
        return child.wait(), child.stdout, child.stderr

    return run


def sample(*positions: float) -> JointState:
    return JointState(name=["trunk"], position=list(positions))


def test_parameters(children: Children, peer: Peer, ros2: Ros2, tmp_path: Path) -> None:
    pid = children.node("pid")
    peer.until_up("pid")

    def ask(verb: str, *words: object) -> tuple[int, str, str]:
        return ros2("param", verb, *PATIENT, "pid", *words)

    assert ask("get", "gains.p") == (0, "Double value is: 60.0\n", "")
    assert ask("get", "autostart", "--hide-type") == (0, "True\n", "")
    assert ask("get", "reference.times") == (0, "Double values are: []\n", "")
    assert ask("get", "gain.p") == (1, "", "Parameter not set\n")
    assert ask("set", "gains.p", "61.5") == (0, "Set parameter successful\n", "")
    assert Services(peer, "pid").get("gains.p") == [61.5]
    refusal = "parameter 'gains.p': -1.0 is not allowed: double, >= 0 and <= 1e+09"
    failed = f"Setting parameter failed: {refusal}\n"
    assert ask("set", "gains.p", "-1.0") == (1, "", failed)
    assert Services(peer, "pid").get("gains.p") == [61.5]

    large = 2**63
    assert ask("set", "gains.p", large) == (1, "", "gains.p: an integer beyond 64 bits\n")

    code, text, errors = ask("dump")
    assert (code, text, errors) == (0, dump(peer, "pid") + "\n", "")
    assert ask("list") == (0, "".join(f"  {name}\n" for name in sorted(_names(text))), "")
    (tmp_path / "pid.yaml").write_text(text.replace("p: 61.5", "p: 62.0"))
    code, text, errors = ask("load", "pid.yaml")
    assert (code, errors) == (0, "")
    assert "Set parameter gains.p successful\n" in text
    assert Services(peer, "pid").get("gains.p") == [62.0]
    (tmp_path / "bad.yaml").write_text("pid: {ros__parameters: {gains: {d: 8.0, p: -1.0}}}")
    successful = "Set parameter gains.d successful\n"
    failed = f"Set parameter gains.p failed: {refusal}\n"
    assert ask("load", "bad.yaml") == (1, successful, failed)

    code, text, errors = ask("load", "none.yaml")
    assert (code, text, errors.count("\n"), "none.yaml" in errors) == (1, "", 1, True)
    code, text, errors = ros2("param", "get", "--timeout", 1, "/pdi", "gains.p")
    assert (code, text, errors.count("\n")) == (1, "", 1)
    assert errors.startswith("Node not found: no node /pdi within 1 s; running nodes: ")
    assert pid.stop() == 0, pid.stderr


def _names(text: str) -> list[str]:
    """Return the names of the parameters in a dump."""

    def under(tree: dict[str, object], above: str) -> list[str]:
        names: list[str] = []
        for key, value in tree.items():
            names += under(value, f"{above}{key}.") if isinstance(value, dict) else [above + key]
        return names

    return under(yaml.safe_load(text)["/pid"]["ros__parameters"], "")


def test_lifecycle(children: Children, peer: Peer, ros2: Ros2) -> None:
    pid = children.node("pid", "autostart:=false")
    peer.until_up("pid")
    done = (0, "Transitioning successful\n", "")
    assert ros2("lifecycle", "get", *PATIENT, "/pid") == (0, "unconfigured [1]\n", "")
    assert ros2("lifecycle", "set", *PATIENT, "/pid", "configure") == done
    assert ros2("lifecycle", "get", *PATIENT, "/pid") == (0, "inactive [2]\n", "")
    assert ros2("lifecycle", "set", *PATIENT, "pid", 3) == done
    assert ros2("lifecycle", "get", *PATIENT, "/pid") == (0, "active [3]\n", "")
    unknown = "Unknown transition requested, available ones are: - deactivate [4] - shutdown [7]\n"
    assert ros2("lifecycle", "set", *PATIENT, "/pid", "configure") == (1, "", unknown)
    assert pid.stop() == 0, pid.stderr


def test_lists(children: Children, peer: Peer, ros2: Ros2) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    while "/pid\n" not in (listed := ros2("node", "list"))[1]:  # what is discovered late is missed
        pass
    assert (listed[0], listed[2]) == (0, "")
    while f"/effort_command [{KIND}]\n" not in (listed := ros2("topic", "list", "-t"))[1]:
        pass
    assert "/_" not in listed[1]
    while "/pid/set_parameters" not in (text := ros2("node", "info", "/pid")[1]):
        pass
    assert text.startswith("/pid\n  Subscribers:\n    /joint_states: sensor_msgs/msg/JointState\n")
    assert text.endswith("  Action Servers:\n\n  Action Clients:\n\n")
    assert ros2("node", "info", "/pdi") == (1, "", "Unable to find node '/pdi'\n")
    assert pid.stop() == 0, pid.stderr


def test_a_topic_and_a_service(children: Children, peer: Peer, ros2: Ros2) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    counts = f"Type: {KIND}\nPublisher count: 1\nSubscription count: 0\n"
    while (info := ros2("topic", "info", "/effort_command")) != (0, counts, ""):
        assert info[2] in ("", "Unknown topic '/effort_command'\n")  # it is discovered late
    code, text, errors = ros2("topic", "info", "-v", "effort_command")
    assert (code, text[: len(KIND) + 8], errors) == (0, f"Type: {KIND}\n\n", "")
    assert "Publisher count: 1\n\nNode name: pid\n" in text
    assert ros2("topic", "info", "/nix") == (1, "", "Unknown topic '/nix'\n")

    kind, service = "rcl_interfaces/srv/GetParameters", "/pid/get_parameters"
    while f"{service} [{kind}]\n" not in (listed := ros2("service", "list", "-t"))[1]:
        pass
    assert (listed[0], listed[2], "/_" in listed[1]) == (0, "", False)
    code, text, errors = ros2("service", "call", service, kind, "{names: [gains.p]}")
    assert (code, errors) == (0, "")
    assert text.startswith("requester: making request: rcl_interfaces.srv.GetParameters_Request(")
    assert "\n\nresponse:\nrcl_interfaces.srv.GetParameters_Response(" in text
    assert "double_value=60.0" in text
    wrong = "Failed to populate field: 'GetParameters_Request' object has no attribute 'nme'\n"
    assert ros2("service", "call", service, kind, "{nme: []}") == (1, "", wrong)
    wrong = "The passed service type is invalid\n"
    assert ros2("service", "call", service, "rcl_interfaces/srv/Nix") == (1, "", wrong)
    assert pid.stop() == 0, pid.stderr


def test_a_reference_is_published(children: Children, peer: Peer, ros2: Ros2) -> None:
    pid = children.node("pid")
    peer.until_up("pid")
    given = "{name: [trunk], position: [1], header: {frame_id: me}}"
    heard = peer.hear_live("/reference")
    code, text, errors = ros2("topic", "pub", "--once", "-w", 2, "/reference", KIND, given)
    assert (code, errors) == (0, "")
    assert "publisher: beginning loop\npublishing #1: sensor_msgs.msg.JointState(" in text
    peer.until(lambda: heard, "the reference is heard")
    assert (heard[0].position.tolist(), heard[0].header.frame_id) == ([1.0], "me")
    assert ros2("topic", "pub", "-w", 2, "-t", 3, "-r", 100, "/reference", KIND, given)[0] == 0
    peer.until(lambda: len(heard) == 4, "three more are heard")

    for values_given, why in (
        ("{nme: [trunk]}", "Failed to populate field: 'JointState' object has no attribute 'nme'"),
        ("{position: [a]}", "Failed to populate field: must be real number, not str"),
        ("5", "The passed value needs to be a dictionary in YAML format"),
    ):
        assert ros2("topic", "pub", "-1", "/reference", KIND, values_given) == (1, "", f"{why}\n")
    wrong = (1, "", "The passed message type is invalid\n")
    assert ros2("topic", "pub", "-1", "/reference", "sensor_msgs/msg/Joint", "{}") == wrong
    assert pid.stop() == 0, pid.stderr


def test_echo_prints_what_is_latched_and_ends(peer: Peer, ros2: Ros2) -> None:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    peer.node.create_publisher(JointState, "/chat", latched).publish(sample(0.25))
    code, text, errors = ros2("topic", "echo", "/chat", KIND, "--once")
    assert (code, errors) == (0, "")
    assert text == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        "name:\n- trunk\nposition:\n- 0.25\nvelocity: []\neffort: []\n---\n"
    )
    shown = ros2("topic", "echo", "/chat", KIND, "--once", "--field", "position")
    assert shown == (0, "array('d', [0.25])\n---\n", "")
    code, text, errors = ros2("topic", "echo", "/chat", KIND, "--once", "--field", "posit")
    why = "'JointState' object has no attribute 'posit'"
    assert (code, text, errors) == (1, "", f"Invalid field 'posit': {why}\n")


def test_what_has_no_end_ends_without_a_word(
    children: Children, peer: Peer, start: Start, domain: int
) -> None:
    publisher = peer.node.create_publisher(JointState, "/chat", 1)
    peer.node.create_timer(0.01, lambda: publisher.publish(sample(0.5)))
    rate = start("topic", "hz", "/chat")
    peer.until(lambda: "average rate: " in rate.stdout, "a rate is shown")
    assert (rate.stop(), rate.stderr) == (signal.SIGINT, "")
    assert "\n\tmin: " in rate.stdout
    piped = f"'{ROS2}' topic echo /chat {KIND} --field name | head -1; echo ${{PIPESTATUS[0]}}"
    child = children.start("piped", "bash", "-c", piped)
    peer.until(lambda: child.process.poll() is not None, "it ends")
    assert (child.stdout, child.stderr) == ("['trunk']\n141\n", "")
