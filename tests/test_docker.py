"""The images: what Dockerfile and compose file say fits the project; `slim`, built and run.

The long tests use Docker where an engine answers and has, or can pull, the base image. Elsewhere they follow
the `slim` target's steps in a clean Debian; what only an engine does is then skipped.
"""

import json
import os
import re
import shutil
import socket
import urllib.error
import urllib.request
from pathlib import Path

import pytest
import yaml

from trunk_runs.nodes import NODES
from trunk_runs.plan import make_plan

from .docker_engine import DOCKER, ROOT, STAGES, TARGETS, CleanRoot, Engine, docker, last
from .finished import finished
from .graph.processes import until

COMPOSE = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))
LONG = [pytest.mark.long, pytest.mark.graph, pytest.mark.timeout(3600)]


@pytest.mark.parametrize("stage", TARGETS)
def test_an_image_is_unprivileged_and_passes_signals_on(stage):
    assert last(stage, "USER") == "trunk"
    init, *_, entrypoint = json.loads(last(stage, "ENTRYPOINT"))  # exec form: JSON
    assert init == "/usr/bin/tini"
    assert os.access(ROOT / Path(entrypoint).relative_to("/opt/trunk"), os.X_OK)
    assert last(stage, "STOPSIGNAL") == "SIGINT"


def test_compose_runs_the_nodes_of_a_plan():
    plan, external = make_plan("fig8", "fuzzy_pid"), make_plan("fig8", "pid", external="mine")
    started = {}
    for name, service in COMPOSE["services"].items():
        command = service["command"]
        if command[:2] == ["ros2", "run"]:
            executable = re.sub(r"^\$\{\w+:-(\w+)\}$", r"\1", command[3])
            assert NODES[executable].package == command[2]
            assert command[-2:] == ["--params-file", "/recordings/params.yaml"]
            server, _ = service["environment"]["ROS_DISCOVERY_SERVER"].split(":")
            assert server in COMPOSE["services"]
            assert service["networks"] == list(COMPOSE["networks"])
            started[name] = executable
    assert sorted(started.values()) == sorted(plan.configs | external.configs)
    others = {"plan", "plan-external", "discovery", "live", "scheduler", "worker", "sweep"}
    assert set(COMPOSE["services"]) - set(started) == others


def test_compose_stops_the_simulator_first_and_the_recorder_last():
    services = COMPOSE["services"]
    assert services["simulator"]["depends_on"] == ["controller", "disturbance"]
    for name in services["simulator"]["depends_on"]:
        assert services[name]["depends_on"] == ["recorder"]
    assert services["recorder"]["depends_on"] == {"discovery": {"condition": "service_healthy"}}


def test_compose_publishes_the_live_page_alone_and_to_this_host_alone():
    published = {name: s["ports"] for name, s in COMPOSE["services"].items() if "ports" in s}
    assert published == {"live": ["127.0.0.1:${PORT:-8080}:8080"]}
    assert all(service["cap_drop"] == ["ALL"] for service in COMPOSE["services"].values())


@pytest.fixture(scope="module")
def slim(tmp_path_factory):
    if Engine.why_not() is None:
        image = Engine(tmp_path_factory.mktemp("recordings"))
        yield image
        image.close()
        return
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        pytest.skip(f"the image slim: {Engine.why_not()}; or root with debootstrap")
    suite = last("base", "FROM").split()[0].removeprefix("debian:").removesuffix("-slim")
    root = CleanRoot(tmp_path_factory.mktemp("slim"), suite)
    try:
        for stage in ("base", "wheels", "trimmed", "built", "slim"):
            root.workdir = "/opt/trunk"
            # Here the build's own tools are still needed after the stage that leaves them out.
            root.follow(() if stage == "trimmed" else STAGES[stage])
        yield root
    finally:
        root.close()
        shutil.rmtree(root.folder)


@pytest.fixture
def engine(slim):
    if not isinstance(slim, Engine):
        pytest.skip(f"what an engine alone does: {Engine.why_not()}")
    return slim


def run(image, *command, **more):
    done = image.run(*command, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


class TestSlim:
    """The image, by an engine or without."""

    pytestmark = LONG

    def test_it_runs_records_and_stops_cleanly(self, slim):
        lockstep = ("trunk", "run", "fig8", "--lockstep", "--duration", "1")
        run(slim, *lockstep, "--output", "whole")
        run(slim, "trunk", "verify", "whole/run.mcap")
        assert (slim.recordings / "whole/run.mcap").stat().st_uid == 1010

        record = ("ros2", "run", "trunk_msgs_util", "recorder", "--ros-args", "-p")
        wrong = slim.run(*record, "overwrite:=no")
        assert wrong.returncode == 2  # the node's exit code, through init and entrypoint

        recorder = slim.start(*record, "output:=/recordings/stopped.mcap")
        stopped = slim.recordings / "stopped.mcap"
        until(lambda: stopped.exists() and stopped.stat().st_size, "the recorder has its file")
        assert slim.stop(recorder) == 1  # it has met no run
        assert stopped.read_bytes().endswith(b"\x89MCAP0\r\n")

    def test_any_user_runs_and_plots_without_a_warning(self, slim):
        folder = slim.recordings / "theirs"
        folder.mkdir()
        os.chown(folder, 4321, 4321) if os.geteuid() == 0 else folder.chmod(0o777)
        for command in (
            ("run", "demo", "--lockstep", "--duration", "1", "--output", "theirs/run"),
            ("simulate", "demo", "--duration", "1", "-o", "theirs/offline.mcap"),
            ("plot", "theirs/run", "-o", "theirs/run.png"),
            ("verify", "theirs/run"),
        ):
            done = run(slim, "trunk", *command, user="4321:4321")
            for word in ("arning", "Permission", "Traceback", "MPLCONFIGDIR"):
                assert word not in done.stderr

    def test_every_part_of_the_libraries_that_is_used_is_there(self, slim):
        run(slim, "trunk", "simulate", "demo", "--duration", "1", "-o", "a.mcap", "--force")
        run(slim, "trunk", "report", "a.mcap", "-o", "a.html", "--force")
        run(slim, "trunk", "export", "a.mcap", "-o", "a.parquet")
        run(slim, "trunk", "tune", "lqr")
        run(slim, "python3", "-c", "import sympy, trunk_studies.paper.errata")

    def test_a_recording_names_the_commit_and_the_image_its_sources(self, engine):
        shown = json.loads(docker("inspect", "trunk:slim").stdout)[0]["Config"]["Labels"]
        about = {name.rpartition(".")[2]: text for name, text in shown.items()}
        assert about["revision"].removesuffix("+dirty") == engine.commit
        assert about["licenses"] == "Apache-2.0"
        assert re.fullmatch(r"[0-9.]+", about["version"])
        assert about["source"]
        run(engine, "trunk", "simulate", "demo", "--duration", "1", "-o", "b.mcap", "--force")
        told = json.loads(run(engine, "trunk", "info", "b.mcap", "--json").stdout)
        assert told["provenance"]["commit"] == about["revision"]
        assert "no commit" not in run(engine, "trunk", "info", "--check", "b.mcap").stdout

    def test_the_page_of_a_published_port(self, engine):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            url = f"http://127.0.0.1:{free.getsockname()[1]}"
        served = ("--host", "0.0.0.0", "--port", "8080", "--url", url)
        port = ("-p", f"{url.removeprefix('http://')}:8080")
        live = engine.start("trunk", "live", "demo", *served, "--output", "live", options=port)
        line = live.stdout.readline()
        assert line.startswith(f"page: {url}/#"), line
        until(lambda: status(url) == 200, "the page is served")
        for other in ("127.0.0.1:8080", "evil.example", "localhost", "0.0.0.0:8080"):
            assert status(url, other) == 403
        engine.stop(live)
        run(engine, "trunk", "info", "live")

    def test_the_commands_of_the_page(self, engine, tmp_path):
        page = (DOCKER / "README.md").read_text(encoding="utf-8")
        build, folder, *commands = re.findall(r"^    (.*)$", page, re.MULTILINE)[:4]
        assert build == "docker/build.sh slim"
        for command in (folder, *commands):
            shell = ["bash", "-euc", command]
            done = finished(shell, cwd=tmp_path)
            assert done.returncode == 0, done.stdout + done.stderr
        assert (tmp_path / "runs/fig8/run.mcap").stat().st_uid == os.getuid()


def status(url, host=""):
    try:
        request = urllib.request.Request(url, headers={"Host": host} if host else {})
        with urllib.request.urlopen(request) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:  # it does not listen yet
        return None
