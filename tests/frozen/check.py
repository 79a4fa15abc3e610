"""Freezes what the project computes, or compares it with what was frozen.

    source scripts/env.sh && python -m tests.frozen.check [compare|make] [runs] [seeds] [edits]

Exit code 1 if something differs that must not; a line for each difference.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from . import caught, verdicts
from .runs import LOCKSTEP, OFFLINE, Fingerprint, offline

ROOT = Path(__file__).resolve().parents[2]
RUNS, SEEDS = (Path(__file__).with_name(f"{part}.json") for part in ("runs", "seeds"))
EDITS = Path(__file__).with_name("edits.json.xz")
MEMORY = "/dev/shm"


def computed(names: Collection[str] = ()) -> Iterator[tuple[str, Fingerprint]]:
    """Yield what comes of the runs with these names, or of all, now."""
    from .seeds import in_lockstep  # puts its own library below rclpy

    with TemporaryDirectory() as folder:
        for runs, run in ((OFFLINE, offline), (LOCKSTEP, in_lockstep)):
            for name in runs:
                if not names or name in names:
                    yield name, run(name, Path(folder))


def frozen_runs() -> dict[str, Fingerprint]:
    """Return what came of each run when it was frozen."""
    return {
        name: Fingerprint(*values)
        for name, values in json.loads(RUNS.read_text(encoding="utf-8")).items()
    }


def differences(before: Fingerprint, now: Fingerprint) -> Iterator[str]:
    """Yield where a run is not as it was."""
    if now.word != before.word:
        yield f"{now.word}, was {before.word}"
    if now.states != before.states:
        yield f"{now.states} states, were {before.states}"
    for topic in sorted({*before.digests, *now.digests}):
        if topic not in now.digests:
            yield f"{topic} is not there"
        elif topic not in before.digests:
            yield f"{topic} was not there"
        elif now.digests[topic] != before.digests[topic]:
            yield f"{topic} has other messages"


def make_runs() -> int:
    """Freeze all runs."""
    lines = [f"{json.dumps(name)}: {json.dumps(run)}" for name, run in computed()]
    RUNS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    print(f"{len(lines)} runs frozen")
    return 0


def compare_runs(names: Collection[str] = ()) -> int:
    """Compare runs with what was frozen: all, or those with these names."""
    if unknown := set(names) - {*OFFLINE, *LOCKSTEP}:
        raise click.UsageError(f"no such run: {', '.join(sorted(unknown))}")
    before, wrong, count = frozen_runs(), 0, 0
    for name, now in computed(names):
        lines = [*differences(before[name], now)] if name in before else ["not frozen"]
        print("".join(f"{name}: {line}\n" for line in lines), end="", flush=True)
        wrong += bool(lines)
        count += 1
    if not names:
        gone = [name for name in before if name not in OFFLINE and name not in LOCKSTEP]
        print("".join(f"{name}: there is no such run now\n" for name in gone), end="")
        wrong += len(gone)
    print(f"{count} runs, {wrong} differ")
    return min(wrong, 1)


def make_seeds() -> int:
    """Freeze the verdicts on all seeds."""
    from .seeds import outcomes

    with TemporaryDirectory(dir=MEMORY) as folder:
        values = verdicts.packed(outcomes(Path(folder)))
    SEEDS.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    print("seeds frozen")
    return 0


def compare_seeds() -> int:
    """Compare the verdicts on seeds with those that were frozen."""
    from .seeds import outcomes

    before = verdicts.unpacked(json.loads(SEEDS.read_text(encoding="utf-8")))
    with TemporaryDirectory(dir=MEMORY) as folder:
        now = list(outcomes(Path(folder)))
    changed = verdicts.changes(before, now)
    print("".join(f"{change.describe()}\n" for change in changed), end="")
    recordings = sum(old.recording != new.recording for old, new in zip(before, now, strict=True))
    count = sum(len(change.seeds) for change in changed)
    print(f"{len(now)} seeds: {count} other verdicts, {recordings} other recordings")
    return int(any(change.wrong for change in changed))


def make_edits() -> int:
    """Freeze what becomes of each edit of the recordings in tests/tampering."""
    edits = _edits()
    EDITS.write_bytes(caught.packed(edits))
    print(f"{len(edits)} edits frozen")
    return 0


def compare_edits() -> int:
    """Compare what becomes of each edit with what was frozen.

    In real time no two recordings are the same: an edit slips through if it passes in each of three.
    """
    before, edits = caught.unpacked(EDITS.read_bytes()), _edits()
    for _ in range(2):
        if slipped := caught.compared(before, edits).slipped:
            print(f"{len(slipped)} edits again: {'; '.join(slipped[:5])}", flush=True)
            edits |= _edits(slipped)
    comparison = caught.compared(before, edits)
    print("\n".join(comparison.lines()))
    return int(comparison.wrong)


def _edits(names: Collection[str] | None = None) -> dict[str, caught.Caught]:
    from .edits import judged_edits

    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    with TemporaryDirectory(dir=MEMORY) as folder:
        return dict(judged_edits(Path(folder), names))


PARTS = {
    "runs": (make_runs, compare_runs),
    "seeds": (make_seeds, compare_seeds),
    "edits": (make_edits, compare_edits),
}


def _in_its_own_process(action: str, part: str, names: Collection[str]) -> int:
    """Do a part where nothing is loaded yet: one part stands in for rclpy, another needs the real one."""
    command = [sys.executable, "-m", "tests.frozen.check", action, part]
    command += [f"--run={name}" for name in names]
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


@click.command()
@click.argument("action", type=click.Choice(["compare", "make"]), default="compare")
@click.argument("parts", type=click.Choice([*PARTS]), nargs=-1)
@click.option("--run", "names", multiple=True, help="Compare only this run; may be repeated.")
def main(action: str, parts: tuple[str, ...], names: tuple[str, ...]) -> None:
    """Compare with what was frozen, or freeze it anew; all parts if none is named."""
    if len(parts) != 1 or os.environ.get("PYTHONHASHSEED") != "0":
        codes = [_in_its_own_process(action, part, names) for part in parts or PARTS]
        raise SystemExit(max(codes))
    make, compare = PARTS[parts[0]]
    if action == "make":
        raise SystemExit(make())
    raise SystemExit(compare_runs(names) if names else compare())


if __name__ == "__main__":
    main()
