"""Mutants of the nodes: each is one edit of the sources, tried in a copy of them.

source scripts/env.sh && python -m tests.seeds.mutants [COUNT] [--only NAME]
"""

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import click

from ..finished import finished

_ROOT = Path(__file__).resolve().parents[2]
_SOURCES = _ROOT / "ros2_ws" / "src"


class Mutant(NamedTuple):
    """An edit: ``old`` becomes ``new``, once, in a file of a package."""

    name: str
    file: str
    old: str
    new: str


_NODE = "trunk_msgs_util/trunk_msgs_util/node/"
_SIM = "trunk_sim/trunk_sim/"
_CONTROL = "trunk_control/trunk_control/"
MUTANTS = (
    Mutant("no word of the end", _SIM + "simulator_node.py",
        'self._say_finished(Event.FINISHED, reason if fell else "finished")', "pass"),
    Mutant("every seventh message is not kept", _NODE + "endpoints.py",
        "self._publish_kept(data)", "self.count % 7 == 6 or self._publish_kept(data)"),
    Mutant("a missed count", _NODE + "endpoints.py", "self.count += 1", "self.count += self.count != 3"),
    Mutant("commands of an inactive controller", _CONTROL + "controller_node.py",
        "        if not output.active:\n            return\n", ""),
    Mutant("parameters change without a word", _NODE + "base.py",
        "self._say_parameters(self.run_stamp_ns, changed)", "pass"),
    Mutant("nobody waits for the recorder at the end", _NODE + "endpoints.py",
        "    known_s = max([born_s", "    return\n    known_s = max([born_s"),
    Mutant("an unflushed file", _NODE + "recorder_node.py",
        "file.finish(complete=complete, reason=reason, sync=True)", "pass"),
    Mutant("nobody says how much there was", _NODE + "base.py",
        "            self.event(Event.PUBLISHED, LEVEL_OK, **counts)\n", "            pass\n"),
    Mutant("a step without its disturbance", _SIM + "pacing.py",
        "topics.DISTURBANCE: -period,", "topics.DISTURBANCE: 0,"),
    Mutant("nobody needs to be met", _SIM + "participants_node.py",
        "return bool(ready) and not (here and here <= listening)", "return False"),
    Mutant("a lost unlock", _SIM + "pacing.py",
        "            self._answered[topic] = stamp_ns\n            self._advance(now_ns)",
        "            self._answered[topic] = stamp_ns - (stamp_ns == 3 * self._loop.period_ns)\n"
        "            self._advance(now_ns)"),
    Mutant("an answer during a pause is lost", _SIM + "pacing.py",
        "        self._unstamped = self._unstamped + 1",
        "        if self.paused:\n            return\n        self._unstamped = self._unstamped + 1"),
    Mutant("doubled disturbances", _NODE + "ahead_node.py",
        "            self._publish(next_ns)\n",
        "            self._publish(next_ns)\n            self._publish(next_ns)\n"),
    Mutant("the first disturbance is missing", _NODE + "ahead_node.py",
        "        if self._sent_ns < stamp_ns:\n            self._publish(stamp_ns)\n", ""),
    Mutant("a reset of the plant is not told", _SIM + "simulator_node.py",
        "        self.event(Event.RESET)\n", ""),
    Mutant("a reset of the controller is not told", _CONTROL + "controller_node.py",
        "        self.event(Event.RESET)\n", ""),
    Mutant("a swapped order", _NODE + "execution.py",
        "                message = handle.take_message(subscription.msg_type, subscription.raw)\n",
        "                message = handle.take_message(subscription.msg_type, subscription.raw)\n"
        "                later = message and handle.take_message(subscription.msg_type, subscription.raw)\n"
        "                if later:\n"
        "                    callback(*later) if with_info else callback(later[0])\n"),
    Mutant("what is recorded is not kept for a late recorder", _NODE + "qos.py",
        "durability=DurabilityPolicy.TRANSIENT_LOCAL", "durability=DurabilityPolicy.VOLATILE"),
    Mutant("a full disk goes unnoticed", _NODE + "recorder_node.py",
        'self.fail(f"{error.filename}: cannot write: {error.strerror}; the recording ends here")', "pass"),
    Mutant("what acted in the last state is not told", _SIM + "simulator_node.py",
        "        self._publish_last_inputs()\n        fell", "        fell"),
    Mutant("an old command's sender is forgotten", _SIM + "pacing.py",
        "Command(stamp_ns, effort, source)",
        'Command(stamp_ns, effort, source if stamp_ns == self._loop.stamp_ns else "")'),
    Mutant("what acted need not be on record", _NODE.removesuffix("node/") + "completeness.py",
        "missing = list(self.acted.missing())", "missing: list[str] = []"),
    Mutant("stopped without a last word", _NODE + "execution.py",
        "        node.end()\n", "        pass\n"),
)  # fmt: skip


def mutated(mutant: Mutant) -> str:
    """Return the text of a mutant's file. Raises ValueError if the sources have changed."""
    text = (_SOURCES / mutant.file).read_text("utf-8")
    if mutant.old not in text:
        raise ValueError(f"{mutant.file} has no {mutant.old!r}: mend the mutant {mutant.name!r}")
    return text.replace(mutant.old, mutant.new, 1)


def copy_with(mutant: Mutant, folder: Path) -> None:
    """Copy the packages' modules and apply a mutant."""
    for package in _SOURCES.iterdir():
        if (package / package.name).is_dir():
            shutil.copytree(package / package.name, folder / package.name)
    folder.joinpath(*Path(mutant.file).parts[1:]).write_text(mutated(mutant), "utf-8")


def found_after(mutant: Mutant, count: int) -> tuple[int | None, str]:
    """Return after how many seeds a mutant was found, None if it was not, and what was said of it."""
    with tempfile.TemporaryDirectory(prefix="mutant_") as name:
        copy_with(mutant, Path(name))
        path = os.pathsep.join([name, os.environ.get("PYTHONPATH", "")])
        words = [sys.executable, "-m", "tests.seeds.check", str(count)]
        environment = {**os.environ, "PYTHONPATH": path}
        done = finished([*words, "--most", "1", "--raw"], cwd=_ROOT, env=environment)
    lines = done.stdout.splitlines()
    if done.returncode == 0 or not lines:
        return None, done.stderr[-300:]
    return int(lines[-1].split()[0]), lines[1].strip() if len(lines) > 1 else ""


@click.command()
@click.argument("count", type=int, default=2000)
@click.option("--only", default="", help="Mutants whose names have this in them.")
def main(count: int, only: str) -> None:
    """Apply each mutant and play up to COUNT seeds; the exit code is 1 if more than one is not found."""
    missed = 0
    for mutant in MUTANTS:
        if only not in mutant.name:
            continue
        seeds, said = found_after(mutant, count)
        missed += seeds is None
        print(
            f"{mutant.name}: {'NOT FOUND' if seeds is None else f'seed {seeds - 1}'}: {said[:120]}",
            flush=True,
        )
    raise SystemExit(missed > 1)


if __name__ == "__main__":
    main()
