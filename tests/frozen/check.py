"""Compares what runs record, and the verdicts on them, with what was frozen.

    source scripts/env.sh && python -m tests.frozen.check [NAME...]       all runs if none is named
    source scripts/env.sh && python -m tests.frozen.check --freeze        freezes all anew

Exit code 1 if something differs; a line for each difference.
"""

import json
import os
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from .runs import LOCKSTEP, OFFLINE, Fingerprint, fingerprint, offline

ROOT = Path(__file__).resolve().parents[2]
RUNS = Path(__file__).with_name("runs.json")


def in_lockstep(name: str, folder: Path) -> Fingerprint:
    """Run a plan's nodes in the virtual world of tests/seeds, and return what came of it."""
    from ..seeds import check  # puts its own library below rclpy
    from ..seeds.story import Story

    plan = LOCKSTEP[name]()
    story = Story(0, True, plan.controller_name, plan.simulator.duration, ())
    found: list[Fingerprint] = []

    def instead(run) -> Iterator[str]:  # of the story's promises: the recording, before it goes
        found.append(fingerprint(run.path, graph=True))
        return iter(())

    with patch.object(check, "broken", instead), patch.object(Story, "plan", lambda *_, **__: plan):
        check.play(story, folder)
    return found[0]


def computed(names: Collection[str]) -> Iterator[tuple[str, Fingerprint]]:
    """Yield what comes of the runs with these names now."""
    with TemporaryDirectory() as folder:
        for name in names:
            yield name, (offline if name in OFFLINE else in_lockstep)(name, Path(folder))


def frozen_runs() -> dict[str, Fingerprint]:
    """Return what came of each run when it was frozen."""
    frozen = json.loads(RUNS.read_text(encoding="utf-8"))
    return {name: Fingerprint(*values) for name, values in frozen.items()}


def differences(names: Collection[str]) -> Iterator[str]:
    """Yield where runs are not as they were."""
    frozen = frozen_runs()
    for name, now in computed(names):
        before = frozen[name]
        if now[:2] != before[:2]:
            yield f"{name}: {now.word} after {now.states} states, was {before.word} after {before.states}"
        for topic in sorted({*before.digests, *now.digests}):
            if now.digests.get(topic) != before.digests.get(topic):
                yield f"{name}: {topic} has other messages"


def main(words: list[str]) -> int:
    names = [*OFFLINE, *LOCKSTEP]
    if words == ["--freeze"]:
        lines = [f"{json.dumps(name)}: {json.dumps(run)}" for name, run in computed(names)]
        RUNS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        return 0
    if unknown := {*words} - {*names}:
        print(f"no such run: {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    count = 0
    for line in differences(words or names):
        print(line, flush=True)
        count += 1
    print(f"{len(words or names)} runs, {count} differences")
    return min(count, 1)


if __name__ == "__main__":
    if os.environ.get("PYTHONHASHSEED") != "0":  # the order of sets of names is part of a run
        command = [sys.executable, "-m", "tests.frozen.check", *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, "PYTHONHASHSEED": "0"})
    sys.exit(main(sys.argv[1:]))
