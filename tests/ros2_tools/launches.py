"""Launch files: ends, refusals, the folder as a bag, and a swap by hand in a launched run."""

import os
import signal
from pathlib import Path

from trunk_evidence.judgement import VERIFIED, verify
from trunk_recording.reader import Recording

from ..finished import finished
from .tools import check, check_verified, listed, node, ros2, running, says, until

LAUNCH = ("launch", "trunk_experiments", "trunk.launch.py")


def lasting(folder: Path, duration: float) -> str:
    """Return the launch argument for a run of this duration, s."""
    file = folder / f"{duration:g}_s.yaml"
    file.write_text(f"/**: {{ros__parameters: {{duration: {duration}}}}}\n", encoding="utf-8")
    return f"params:={file}"


def check_launch(folder: Path) -> None:
    says("ros2 launch --show-args", (*LAUNCH, "--show-args"), "'scenario'", "'lockstep'")
    run = folder / "launched"
    given = (lasting(folder, 1.0), "lockstep:=true")
    text = says("ros2 launch, lock-step", (*LAUNCH, *given, f"output:={run}"), "the run is over")
    check("... gives our reason at its end", "was required" not in text, text)
    check_verified("... its folder is a bag, and verified", run)
    bad = (*LAUNCH, "scenario:=nowhere", f"output:={folder / 'bad'}")
    says("ros2 launch of an unknown scenario", bad, "nowhere", code=1)
    for name in ("pid", "simulator", "recorder"):
        check_one_is_ended(folder, name)
    first = (*LAUNCH, lasting(folder, 3600.0), f"output:={folder / 'first'}")
    with running(*first) as process:
        until(lambda: "/simulator" in listed("node", "list"))
        second = ros2(*LAUNCH, lasting(folder, 1.0), f"output:={folder / 'second'}")
        check("a second launch in the same namespace is refused", second.returncode, second.stdout)
        process.wait(120)


def check_one_is_ended(folder: Path, name: str) -> None:
    """One node of a launched run is asked to end: the others end too, and the run is not complete."""
    run = folder / f"without_{name}"
    words = (*LAUNCH, "controller:=pid", lasting(folder, 3600.0), f"output:={run}")
    with running(*words) as launched:
        until(lambda: f"/{name}" in listed("node", "list") and (run / "run.mcap").exists())
        # Of the nodes on this machine, the one that records here.
        mine = ("pgrep", "-f", f"lib/trunk_[a-z]+(_[a-z]+)?/{name} --ros-args.*{run}")
        pids = finished(mine).stdout.split()
        if len(pids) != 1:
            os.killpg(launched.pid, signal.SIGINT)
            output, _ = launched.communicate(timeout=120)
            check(f"ros2 launch starts {name}", False, output)
            return
        os.kill(int(pids[0]), signal.SIGTERM)
        output, _ = launched.communicate(timeout=120)
        said = "incomplete: " in output and f"{name} ended with exit code" in output
        check(f"{name} ends on SIGTERM: the launch ends with code 1", launched.returncode == 1)
        check("... and says what lacks", said, output)


def check_swap(folder: Path) -> None:
    run = folder / "swapped"
    words = (*LAUNCH, "controller:=pid", lasting(folder, 60.0), f"output:={run}")
    with running(*words) as launched:
        until(lambda: "/pid" in listed("lifecycle", "nodes"))
        with running(*node("trunk_control", "fuzzy_pid", "autostart:=false")):
            until(lambda: "/fuzzy_pid" in listed("lifecycle", "nodes"))
            for name, label in (
                ("fuzzy_pid", "configure"),
                ("pid", "deactivate"),
                ("fuzzy_pid", "activate"),
                ("fuzzy_pid", "deactivate"),
                ("pid", "activate"),
            ):
                set_to = ("lifecycle", "set", f"/{name}", label)
                says(f"in a launched run: {name} {label}", set_to, "Transitioning successful")
        launched.communicate(timeout=300)
    verdict = verify(Recording.open(run / "run.mcap"))
    parts = {part.name: part.steps for part in verdict.checks}
    check("the swap by hand is verified", verdict.exit_code == VERIFIED, str(verdict.reasons))
    check(
        "... commands of both", min(parts.get(f"commands of {n}", 0) for n in ("pid", "fuzzy_pid"))
    )
    like = ["trunk", "simulate", "--like", str(run / "run.mcap"), "-o", str(folder / "like.mcap")]
    done = finished(like)
    check("... and can be repeated (trunk simulate --like)", done.returncode == 0, done.stderr)
