"""The stand-in for `ros2`, and scripts/run.sh before anything is set up."""

import shutil
from pathlib import Path

import pytest

from .finished import finished

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("words", "instead"),
    [
        ("launch trunk_experiments trunk.launch.py", "trunk run SCENARIO"),
        ("bag info a", "trunk info BAG"),
        ("bag record -a", "ros2 run trunk_msgs_util recorder"),
        ("action send_goal /simulator/reset std_srvs/srv/Trigger", ""),
    ],
)
def test_a_verb_that_it_lacks_names_what_does_the_same(words: str, instead: str) -> None:
    done = finished([ROOT / "scripts/standin/ros2", *words.split()])
    shown = f": {instead} does it" if instead else ""
    verb = " ".join(words.split()[:2])
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith(
        f"ros2 (stand-in): no '{verb}' here{shown}; the stand-in has run, pkg executables, "
    )


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            "topic pub -r 0 /a std_msgs/msg/Empty {}",
            "ros2 topic pub: error: argument -r/--rate: it must be positive: 0; it takes ",
        ),
        (
            "topic echo --qos-reliability foo /a",
            "ros2 topic echo: error: argument --qos-reliability: invalid choice: 'foo' (choose from ",
        ),
        (
            "topic bw /a",
            "ros2 (stand-in): no 'topic bw' here; the stand-in has topic list, topic info, ",
        ),
        (
            "topic list --bw",
            "ros2 topic list: error: unrecognized arguments: --bw; it takes -t/--show-types ",
        ),
        (
            "param set /pid",
            "ros2 param set: error: the following arguments are required: parameter_name, value; ",
        ),
        (
            "topic hz -w x /a",
            "ros2 topic hz: error: argument -w/--window: invalid int value: 'x'; it takes ",
        ),
        (
            "run",
            "ros2 run: error: the following arguments are required: package_name, executable_name; ",
        ),
    ],
)
def test_a_mistake_is_one_line_that_names_what_there_is(words: str, line: str) -> None:
    done = finished([ROOT / "scripts/standin/ros2", *words.split()])
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith(line)


def test_an_interface_is_shown_with_what_is_in_it() -> None:
    done = finished(
        [ROOT / "scripts/standin/ros2", "interface", "show", "sensor_msgs/msg/JointState"]
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("# This is a message that holds data")
    nested = "builtin_interfaces/Time stamp\n\t\tint32 sec\n\t\tuint32 nanosec\n\tstring frame_id"
    assert f"\nstd_msgs/Header header\n\t{nested}\n\nstring[] name\n" in done.stdout
    done = finished([ROOT / "scripts/standin/ros2", "interface", "show", "Nix"])
    assert (done.returncode, done.stderr) == (1, "Could not find the interface 'Nix'\n")


def test_executables_are_found_and_started() -> None:
    def ros2(*words: str) -> tuple[int, str, str]:
        done = finished([ROOT / "scripts/standin/ros2", *words])
        return done.returncode, done.stdout, done.stderr

    prefix = ROOT / "ros2_ws/install/trunk_sim"
    listed = "trunk_sim disturbance\ntrunk_sim simulator\n"
    assert ros2("pkg", "executables", "trunk_sim") == (0, listed, "")
    assert listed in ros2("pkg", "executables")[1]
    paths = "".join(f"{prefix}/lib/trunk_sim/{name}\n" for name in ("disturbance", "simulator"))
    assert ros2("pkg", "executables", "--full-path", "trunk_sim") == (0, paths, "")
    assert ros2("pkg", "prefix", "trunk_sim") == (0, f"{prefix}\n", "")
    assert ros2("pkg", "prefix", "--share", "trunk_sim") == (0, f"{prefix}/share/trunk_sim\n", "")
    assert "usage: simulator" in ros2("run", "trunk_sim", "simulator", "--help")[1]
    missing = "no executable 'sim' in trunk_sim; it has: disturbance simulator\n"
    assert ros2("run", "trunk_sim", "sim", "--ros-args") == (1, "", missing)
    code, said, line = ros2("run", "trunk_smi", "simulator")
    assert (code, said, line.count("\n")) == (1, "", 1)
    assert line.startswith("package 'trunk_smi' not found; packages with executables: ")
    assert "trunk_sim" in line


def test_help_of_run_needs_no_set_up(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/run.sh", tmp_path / "scripts")
    done = finished(["bash", tmp_path / "scripts/run.sh", "--help"])
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: scripts/run.sh SCENARIO --controller NAME")
