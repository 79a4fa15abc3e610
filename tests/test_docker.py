"""The images: what Dockerfile and compose file say fits the project; `slim`, built without an engine.

The slow test follows the `slim` target's steps, as they stand in the Dockerfile, in a clean Debian.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
import yaml

from trunk_experiments.plans.nodes import NODES
from trunk_experiments.plans.plan import make_plan

ROOT = Path(__file__).parents[1]
DOCKER = ROOT / "docker"
COMPOSE = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))
DEBIAN = "http://deb.debian.org/debian"


def stages(text):
    """Return a Dockerfile's stages: name -> [(instruction, arguments)], the first one being FROM."""
    text = re.sub(r"^\s*#.*\n", "", text, flags=re.MULTILINE)
    found = {}
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        if line.strip():
            instruction, _, arguments = line.strip().partition(" ")
            if instruction == "FROM":
                steps = found.setdefault(arguments.split(" AS ")[1], [])
            steps.append((instruction, arguments.strip()))
    return found


STAGES = stages((DOCKER / "Dockerfile").read_text(encoding="utf-8"))


def last(stage, instruction):
    return [arguments for name, arguments in STAGES[stage] if name == instruction][-1]


def test_the_two_targets():
    assert last("slim", "FROM").startswith("debian:")
    assert last("ros", "FROM").split()[0] == "ros:jazzy-ros-base"
    assert list(STAGES) == ["slim", "ros"]


@pytest.mark.parametrize("stage", STAGES)
def test_an_image_is_unprivileged_and_passes_signals_on(stage):
    assert last(stage, "USER") == "trunk"
    entrypoint = json.loads(last(stage, "ENTRYPOINT"))  # exec form: JSON
    assert entrypoint[0] == "/usr/bin/tini"
    assert (ROOT / Path(entrypoint[-1]).relative_to("/opt/trunk")).is_file()
    assert os.access(DOCKER / "entrypoint.sh", os.X_OK)
    assert isinstance(json.loads(last(stage, "CMD")), list)
    assert last(stage, "STOPSIGNAL") == "SIGINT"
    assert (DOCKER / "entrypoint.sh").read_text().rstrip().endswith('exec "$@"')


def test_the_context_leaves_out_what_is_built_here():
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert {".git", ".venv", "ros2_ws/build", "ros2_ws/install", "runs"} <= set(ignored)


def test_compose_runs_the_nodes_of_a_plan():
    plan, external = make_plan("fig8", "fuzzy_pid"), make_plan("fig8", "pid", external="mine")
    started = {}
    for name, service in COMPOSE["services"].items():
        command = service["command"]
        if command[:2] == ["ros2", "run"]:
            executable = re.sub(r"^\$\{\w+:-(\w+)\}$", r"\1", command[3])
            assert NODES[executable].package == command[2]
            assert command[-2:] == ["--params-file", "/recordings/params.yaml"]
            started[name] = executable
    assert sorted(started.values()) == sorted(plan.configs | external.configs)
    assert set(COMPOSE["services"]) - set(started) == {"plan", "plan-external", "discovery"}


def test_compose_stops_the_simulator_first_and_the_recorder_last():
    services = COMPOSE["services"]
    assert services["simulator"]["depends_on"] == ["controller", "disturbance"]
    for name in services["simulator"]["depends_on"]:
        assert services[name]["depends_on"] == ["recorder"]
    assert services["recorder"]["depends_on"] == ["discovery"]


def test_every_service_is_on_the_one_network_with_the_discovery_server_and_the_volume():
    for service in COMPOSE["services"].values():
        assert service["networks"] == list(COMPOSE["networks"])
        assert service["volumes"] == ["recordings:/recordings"]
        assert service["environment"]["ROS_DISCOVERY_SERVER"].split(":")[0] in COMPOSE["services"]
        assert "ports" not in service
    assert list(COMPOSE["volumes"]) == ["recordings"]


class CleanRoot:
    """A Debian in a folder, in which a Dockerfile's steps are done with chroot."""

    def __init__(self, folder, suite):
        self.folder = folder
        self.user, self.workdir = "root", "/"
        subprocess.run(["debootstrap", "--variant=minbase", suite, folder, DEBIAN], check=True)
        folder.chmod(0o755)  # it is the root folder of other users too
        # What an engine gives to a build: name service, proxies, and here the host's certificates.
        for name in ("resolv.conf", "hosts"):
            shutil.copy(f"/etc/{name}", folder / "etc" / name)
        extra = folder / "usr/local/share/ca-certificates"
        extra.mkdir(parents=True, exist_ok=True)
        shutil.copy("/etc/ssl/certs/ca-certificates.crt", extra / "host.crt")
        self._mounts = [folder / "proc", folder / "dev"]
        subprocess.run(["mount", "-t", "proc", "proc", self._mounts[0]], check=True)
        subprocess.run(["mount", "--bind", "/dev", self._mounts[1]], check=True)

    def close(self):
        for mount in self._mounts:
            subprocess.run(["umount", "--lazy", mount], check=True)

    def argv(self, *command):
        home = "/root" if self.user == "root" else f"/home/{self.user}"
        passed = [
            f"{k}={v}"
            for k, v in os.environ.items()
            if k.lower().endswith("_proxy") or k in ("PIP_CERT", "PIP_INDEX_URL")
        ]
        path = "PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        inside = ["/usr/bin/env", "-i", f"--chdir={self.workdir}", path, f"HOME={home}", *passed]
        return ["chroot", f"--userspec={self.user}:{self.user}", self.folder, *inside, *command]

    def copy(self, arguments):
        owner, source, target = arguments.split()
        assert (owner, source, target) == ("--chown=trunk:trunk", ".", ".")
        tracked = subprocess.run(
            ["git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            capture_output=True,
            check=True,
        ).stdout.decode()
        for name in filter(None, tracked.split("\0")):
            place = self.folder / self.workdir.lstrip("/") / name
            place.parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / name).is_file():
                shutil.copy2(ROOT / name, place)
        subprocess.run(
            ["chroot", self.folder, "chown", "-R", "trunk:trunk", self.workdir], check=True
        )

    def follow(self, steps):
        for instruction, arguments in steps:
            if instruction == "RUN":
                subprocess.run(self.argv("/bin/sh", "-c", arguments), check=True)
            elif instruction == "COPY":
                self.copy(arguments)
            elif instruction == "USER":
                self.user = arguments
            elif instruction == "WORKDIR":
                self.workdir = arguments
            else:
                assert instruction in ("FROM", "VOLUME", "STOPSIGNAL", "ENTRYPOINT", "CMD")


@pytest.fixture(scope="module")
def slim(tmp_path_factory):
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        pytest.skip("the image's stages: as root, with Debian's debootstrap")
    suite = last("slim", "FROM").split()[0].removeprefix("debian:").removesuffix("-slim")
    root = CleanRoot(tmp_path_factory.mktemp("slim"), suite)
    try:
        root.follow(STAGES["slim"])
        yield root
    finally:
        root.close()
        shutil.rmtree(root.folder)


def in_container(root, *command):
    return root.argv(*json.loads(last("slim", "ENTRYPOINT")), *command)


@pytest.mark.slow
@pytest.mark.graph
@pytest.mark.timeout(1800)
def test_the_slim_image_runs_records_and_stops_cleanly(slim):
    run = ["trunk", "run", "fig8", "--lockstep", "--duration", "1", "--output", "whole"]
    subprocess.run(in_container(slim, *run), check=True)
    subprocess.run(in_container(slim, "trunk", "verify", "whole/run.mcap"), check=True)
    assert (slim.folder / "recordings/whole/run.mcap").stat().st_uid == 1010

    record = ["ros2", "run", "trunk_msgs_util", "recorder", "--ros-args", "-p"]
    wrong = subprocess.run(in_container(slim, *record, "compression:=no"), check=False)
    assert wrong.returncode == 2  # the node's exit code, through init and entrypoint

    # `docker stop`, seen from the recorder: the stop signal to process 1
    recorder = subprocess.Popen(in_container(slim, *record, "output:=/recordings/stopped.mcap"))
    stopped = slim.folder / "recordings/stopped.mcap"
    deadline = time.monotonic() + 30.0
    while not (stopped.exists() and stopped.stat().st_size) and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(1.0)
    recorder.send_signal(getattr(signal, last("slim", "STOPSIGNAL")))
    assert recorder.wait(9.0) == 0  # docker stop kills after 10 s
    assert stopped.read_bytes().endswith(b"\x89MCAP0\r\n")
