"""Nodes alone: packages, topics, parameters, services, lifecycle, and what is as in ros2_control."""

import os
import signal
from pathlib import Path

import yaml

from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording

from ..finished import finished
from .tools import check, listed, node, ros2, running, says, until

EXECUTABLES = {
    "trunk_sim": ("simulator", "disturbance"),
    "trunk_control": ("pid", "fuzzy_pid", "lqr", "computed_torque", "state_feedback"),
    "trunk_msgs_util": ("recorder",),
}


def check_packages() -> None:
    packages = listed("pkg", "list")
    for package, executables in EXECUTABLES.items():
        check(f"ros2 pkg list has {package}", package in packages)
        found = listed("pkg", "executables", package)
        check(f"ros2 pkg executables {package}", set(executables) <= found, str(found))
    says("ros2 interface show", ("interface", "show", "sensor_msgs/msg/JointState"), "effort")


def check_runs(folder: Path) -> None:
    given = {"recorder": (f"output:={folder / 'alone.mcap'}",)}
    for package, executables in EXECUTABLES.items():
        for name in executables:
            with running(*node(package, name, *given.get(name, ()))) as process:
                there = until(lambda name=name: f"/{name}" in listed("node", "list"))
                check(f"ros2 run {package} {name}: in ros2 node list", there)
                os.killpg(process.pid, signal.SIGINT)
                output, _ = process.communicate(timeout=120)
                check(f"{name} ends on Ctrl-C with code 0", process.returncode == 0, output)


def check_topics(folder: Path) -> None:
    recording = folder / "topics.mcap"
    with (
        running(*node("trunk_msgs_util", "recorder", f"output:={recording}")),
        running(*node("trunk_control", "pid", "reference.profile:=topic")),
        running(*node("trunk_sim", "simulator", "duration:=0.0", "publish_clock:=true")),
    ):
        until(lambda: {"/clock", "/reference"} <= listed("topic", "list"))
        shown, hidden = listed("topic", "list"), listed("topic", "list", "--include-hidden-topics")
        for topic in (
            "/joint_states",
            "/ground_truth/joint_states",
            "/effort_command",
            "/reference",
        ):
            check(f"ros2 topic list has {topic}", topic in shown, str(shown))
        check("the recorder's own topics are hidden", not any("/_" in name for name in shown))
        check("... and there", "/_joint_states" in hidden, str(hidden))
        says("ros2 topic type", ("topic", "type", "/joint_states"), "sensor_msgs/msg/JointState")
        info = says(
            "ros2 topic info -v", ("topic", "info", "-v", "/joint_states"), "Node name: sim"
        )
        check("live topics are volatile", "TRANSIENT_LOCAL" not in info, info)
        heard = [ros2("topic", "echo", "--once", "/joint_states").stdout for _ in range(2)]
        stamps = [yaml.safe_load(text.split("---")[0])["header"]["stamp"] for text in heard]
        seconds = [stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in stamps]
        check("ros2 topic echo shows the present", 0.0 < seconds[0] < seconds[1], str(seconds))
        message = "{name: [trunk], position: [0.1]}"
        kind = "sensor_msgs/msg/JointState"
        words = ("topic", "pub", "--times", 3, "-w", 2, "/reference", kind, message)
        says("ros2 topic pub to /reference", words, "publishing #3")
        says("ros2 node info", ("node", "info", "/simulator"), "/effort_command", "/joint_states")
        check_parameters(folder)
        check_services()
    found = Recording.open(recording)
    check("what ros2 topic pub sent is recorded", found.topics["/reference"].count == 3)
    check("the recording is complete", found.complete, str(found.warnings))
    verdict = verify(found)
    check("... and verified", verdict.exit_code == VERIFIED, str(verdict.reasons))


def check_parameters(folder: Path) -> None:
    says("ros2 param list", ("param", "list", "/pid"), r"gains\.p", r"reference\.profile")
    says("ros2 param get", ("param", "get", "/pid", "gains.p"), r"Double value is: 60\.0")
    says("ros2 param describe", ("param", "describe", "/pid", "gains.p"), "Proportional gain")
    says("ros2 param set", ("param", "set", "/pid", "gains.p", "61.0"), "successful")
    says("... out of range", ("param", "set", "/pid", "gains.p", ".nan"), "gains.p", code=0)
    says("... fixed at start", ("param", "set", "/pid", "joint", "hip"), "joint", code=0)
    for name in ("pid", "simulator", "recorder"):
        dump = folder / f"{name}.yaml"
        dump.write_text(says(f"ros2 param dump /{name}", ("param", "dump", f"/{name}"), name))
        text = says(f"ros2 param load /{name}, unchanged", ("param", "load", f"/{name}", dump))
        check("... refuses nothing", "fail" not in text.lower(), text)
    says("the reference lets go", ("param", "set", "/pid", "reference.profile", "constant"), "succ")
    (folder / "pid.yaml").write_text(ros2("param", "dump", "/pid").stdout)
    dumped = ["trunk", "simulate", "fig8", "--controller", "pid", "--params", folder / "pid.yaml"]
    done = finished([*map(str, dumped), "--duration", "0.1", "-o", str(folder / "dumped.mcap")])
    check("trunk simulate --params takes the dump", done.returncode == 0, done.stderr)


def check_services() -> None:
    says("ros2 service list", ("service", "list"), "/simulator/reset", "/pid/reset")
    says("ros2 service type", ("service", "type", "/simulator/pause"), "std_srvs/srv/SetBool")
    for name, value in (("pause", "{data: true}"), ("pause", "{data: false}"), ("reset", "{}")):
        kind = "std_srvs/srv/" + ("SetBool" if name == "pause" else "Trigger")
        words = ("service", "call", f"/simulator/{name}", kind, value)
        says(f"ros2 service call /simulator/{name} {value}", words, "success=True")


def check_lifecycle() -> None:
    with running(*node("trunk_control", "pid", "autostart:=false")):
        until(lambda: "/pid" in listed("lifecycle", "nodes"))
        says("ros2 lifecycle nodes", ("lifecycle", "nodes"), "/pid")
        says("ros2 lifecycle get", ("lifecycle", "get", "/pid"), "unconfigured")
        for label in ("configure", "activate", "deactivate", "cleanup"):
            words = ("lifecycle", "set", "/pid", label)
            says(f"ros2 lifecycle set /pid {label}", words, "Transitioning successful")
        says("a transition that there is not", ("lifecycle", "set", "/pid", "activate"), code=1)


def check_as_in_ros2_control() -> None:
    kind, one = "sensor_msgs/msg/JointState", "{name: [trunk], position: [0.1]}"
    with (
        running(*node("trunk_control", "fuzzy_pid", "reference.profile:=topic")),
        running(*node("trunk_sim", "simulator", "duration:=0.0")),
    ):
        until(lambda: "/fuzzy_pid/reference" in listed("topic", "list"))
        words = ("topic", "pub", "--once", "-w", 1, "/fuzzy_pid/reference", kind, one)
        says("ros2 topic pub to ~/reference", words, "publishing #1")
        words = ("topic", "echo", "--once", "/fuzzy_pid/controller_state")
        text = says("ros2 topic echo ~/controller_state", words, "- reference", "- effort")
        record = yaml.safe_load(text.split("---")[0])
        values = dict(zip(record["name"], record["position"], strict=True))
        check("... where the reference has arrived", values["reference"] == 0.1, str(values))
