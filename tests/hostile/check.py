"""Hostile files × verbs, each under 2 GB and 30 s: one line per file, and what went wrong.

    OPENBLAS_NUM_THREADS=1 python -m tests.hostile.check [--selection] [NAME...]

``--selection``: a few verbs and an eighth of the quicker files, for CI. NAME: only files with it in theirs.
Of all files, then also how soon a signal ends each verb.
"""

import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from ros2_ws.src.trunk_experiments.test import verbs

from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from . import bombs, indexed, limited, oracle, signals, tampered, texts

WRONG = "wrong number"
# Verbs that between them read everything; the others read the same.
_SELECTED = ("info --json", "metrics --json", "info --check", "recover", "plan --params")
_OTHERS_S = 5.0  # of the processor's time for the other libraries
_EVERY = 40  # of the tampered files, for the selection
_SLOW = (
    *("names", "layout", "parameters", "in each", "in turn", "nothing", "long event", "repeated"),
    *("resets", "schemas", "LZ4", "overlap", "often", "everywhere", "a long list", "a long topic"),
    *("many", "deep", "a long text", "whitespace", "for each"),
)


def base_run(path: Path) -> Path:
    """Write a sound run."""
    plan = make_plan("fig8", "fuzzy_pid")
    plan = replace(plan, simulator=replace(plan.simulator, duration=0.6))
    record_offline(plan, path, overwrite=True)
    return path


def _recordings(base: Path) -> Iterator[tuple[str, Callable[[Path], Path]]]:
    for name, change in tampered.FILES.items():
        yield name, partial(change, base)
    for name in bombs.FILES:
        yield name, partial(bombs.make, name)
    yield from indexed.INDEXED.items()
    for name, bag in indexed.BAGS.items():
        yield name, partial(_bag, bag, base)


def _bag(make: Callable[[Path, Path], Path], base: Path, path: Path) -> Path:
    return make(path.with_suffix(""), base)


def selected(number: int, name: str) -> bool:
    """Return True for a file whose turn it is in CI's runs."""
    turn = number + int(os.environ.get("TRUNK_EPOCH", "0"))
    if number < len(tampered.FILES):
        return turn % _EVERY == 0
    return turn % 8 == 0 and not any(word in name for word in _SLOW)


def tried(
    name: str, path: Path, base: Path, folder: Path, only: tuple[str, ...]
) -> tuple[Counter[str], list[str], str]:
    """Run the verbs on a file; return the verdicts' numbers, lines on what is wrong, and figures."""
    text = texts.TEXTS.get(name)
    wanted = (
        verbs.of_recording(path, base, folder)
        if text is None
        else verbs.of_text(path, text, folder)
    )
    counts: Counter[str] = Counter()
    lines: list[str] = []
    done: dict[str, limited.Outcome] = {}
    for verb, arguments in wanted.items():
        if only and verb not in only:
            continue
        done[verb] = outcome = limited.run(arguments, folder)
        counts[outcome.verdict] += 1
        if outcome.verdict != limited.FINE:
            said = [line for line in outcome.err.splitlines() if line.strip()]
            lines.append(f"{verb}: {outcome.verdict}: {' '.join(said[-1:])[:150]}")
    compared = ""
    if text is None and path.is_file():
        compared, found = _against_others(path, folder, done)
        counts[WRONG] += len(found)
        lines += found
    slowest = max(done, key=lambda verb: done[verb].seconds)
    peak = max(outcome.peak for outcome in done.values())
    return (
        counts,
        lines,
        f"{done[slowest].seconds:.1f} s ({slowest}), {peak >> 20} MiB{compared}",
    )


def _against_others(
    path: Path, folder: Path, done: dict[str, limited.Outcome]
) -> tuple[str, list[str]]:
    info = done.get("info --json")
    if info is None or info.code:
        return "", []
    metrics = done.get("metrics --json")
    export = done.get("export")
    table = folder / "a.csv" if export is not None and export.code == 0 else None
    told = metrics.out if metrics is not None and metrics.code == 0 else ""

    def compare() -> None:
        for line in oracle.wrong(path, info.out, told, table):
            print(line)

    # Files that these libraries cannot read in that time, or at all, are not compared.
    outcome = limited.call(compare, folder, _OTHERS_S)
    return ("", []) if outcome.code else (", compared", outcome.out.splitlines())


def main() -> int:
    """Run the check; return 1 if anything went wrong."""
    arguments = [a for a in sys.argv[1:] if a != "--selection"]
    selection = len(arguments) < len(sys.argv) - 1
    limited.load()
    oracle.load()
    total: Counter[str] = Counter()
    files = 0
    with tempfile.TemporaryDirectory(prefix="hostile") as name:
        folder = Path(name)
        base = base_run(folder / "base.mcap")
        jobs: list[tuple[str, Callable[[Path], Path]]] = list(_recordings(base))
        jobs += [(title, partial(_text, text)) for title, text in texts.TEXTS.items()]
        for number, (title, make) in enumerate(jobs):
            if arguments and not any(word in title for word in arguments):
                continue
            if selection and not selected(number, title):
                continue
            path = make(folder / f"{number}.mcap")
            counts, lines, figures = tried(
                title, path, base, folder, _SELECTED if selection else ()
            )
            total += counts
            files += 1
            bad = sum(n for verdict, n in counts.items() if verdict != limited.FINE)
            print(f"{'FAIL' if bad else 'ok  '}  {title}: {figures}", flush=True)
            for line in lines:
                print(f"        {line}", flush=True)
            if path.is_file():
                path.unlink()
    wrong = {v: total[v] for v in (limited.TRACEBACK, limited.TIME_OUT, limited.NOISE, WRONG)}
    said = ", ".join(f"{n} {v}" if v == limited.NOISE else f"{n} {v}s" for v, n in wrong.items())
    print(f"{files} files, {sum(total.values()) - total[WRONG]} calls: {said}")
    return 1 if any(wrong.values()) else 0


def _text(text: str, path: Path) -> Path:
    path = path.with_suffix(".yaml")
    path.write_text(text, encoding="utf-8")
    return path


if __name__ == "__main__":
    sys.exit(main() or (len(sys.argv) == 1 and signals.main()))
