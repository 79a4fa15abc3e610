"""Every verb with every bad argument: an error or a warning in one line, and nothing lost on disk.

    python -m tests.hostile.arguments [--every N] [VERB...]

``--every N``: only every Nth case, for CI. The arguments are a careless user's: typos, swapped files, wrong
units, and outputs in the wrong place. ``{input}`` stands for the verb's input, ``{kept}`` for a file that
exists, with the suffix that the verb writes.
"""

import os
import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from resource import RLIM_INFINITY
from typing import NamedTuple

from ros2_ws.src.trunk_experiments.test.verbs import VERBS, Verb, furnish

from . import limited


class Case(NamedTuple):
    """Arguments with something wrong in them."""

    what: str
    arguments: tuple[str, ...]
    replaces_input: bool = False  # in place of the verb's inputs, else after them


def _typos() -> Iterator[Case]:
    for option in (
        *("--hepl", "--jsno", "--forse", "--otput", "--ouput=x", "--contoller=pid", "--parms=x"),
        *("--lock-step", "--lockstp", "--durations=1", "--duraton=1", "--setting=a=b", "--seeds=1"),
        *(
            "--verson",
            "-j",
            "-f",
            "-O",
            "-v",
            "-x",
            "--",
            "---",
            "--=",
            "--no-such",
            "-oo",
            "-ojson",
        ),
    ):
        if option != "--":
            yield Case("option", (option,))


_MISSING = (
    *("nosuch.mcap", "nosuch", "no/such/run.mcap", "run.mcpa", "a.mcap.gz", "a.mcap "),
    *("", " ", ".", "..", "/", "~", "~/a.mcap", "*.mcap", "a.mcap,b.mcap", "-", "/dev/null"),
    *("/dev/full", "/proc/self/mem", "/usr/../nosuch", "file:///a.mcap", "https://a.b/c.mcap"),
    *("a\nb.mcap", "\x1b[31m.mcap", "\u202e.mcap", "x" * 300, "fig10", "fig 6", "fig66", "Fig6"),
    *("demo.yaml", "delay", "robust", "pid", "fuzzypid", "fuzzy-pid", "simulator", "42", "nan"),
)
_SWAPPED = (
    *("page.html", "picture.png", "table.csv", "swept.parquet", "params.yaml", "study.yaml"),
    *("empty.mcap", "broken.mcap", "cut.mcap", "picture.mcap", "yaml.mcap", "parquet.mcap"),
    *("folder", "hollow", "two", "loop", "dangling", "pipe.json", "bad.yaml"),
)


def _inputs() -> Iterator[Case]:
    for name in _MISSING:
        yield Case("missing input", (name,), True)
    for name in _SWAPPED:
        yield Case("another kind of input", (name,), True)
    for name in ("a.mcap", "fig6", "params.yaml", "surplus"):
        yield Case("one too many", (name, "surplus", "surplus"))


def _outputs() -> Iterator[Case]:
    for option in ("-o", "--output"):
        for place in (
            *("{input}", "{kept}", "a.mcap", "b.mcap", "params.yaml", "study.yaml", "folder", "."),
            *(
                "..",
                "/",
                "",
                " ",
                "no/such/folder/x",
                "/proc/x",
                "/dev/full",
                "x",
                "x.",
                ".x",
                "x.txt",
            ),
            *("x.mcap.bak", "x.MCAP2", "a.mcap/x", "dangling", "loop", "x" * 300 + ".mcap"),
        ):
            yield Case("output", (option, place))
        yield Case("output", (option,))
        yield Case("output", (option, "x.txt", "--force"))
        yield Case("output", (option, "{input}", "--force"))
        yield Case("output", (option, "folder", "--force"))


def _values() -> Iterator[Case]:
    for setting in (
        *("", "=", "a", "a=b", "pid", "pid.", "pid=", "pid.gains", "pid.gains.p", "pid.gains.p="),
        *("pid.gains.p=abc", "pid.gains.p=nan", "pid.gains.p=-1", "pid.gains.p=1e999"),
        *("pid.gains.p=4kg", "pid.gains.p=4 5", "pid.gains.p=[4]", "pid.gain.p=4", "pdi.gains.p=4"),
        *("lqr.gains.p=4", "simulator.initial.position=[0,30]", "simulator.initial.position=0.1"),
        *("simulator.initial.position=[0,45m]", "simulator.duration=-1", "simulator.duration=10kg"),
        *("simulator.update_rate=0", "simulator.update_rate=1e9", "simulator.nosuch=1"),
        *("simulator.hip.mode=flying", "fuzzy_pid.rules.kp=[B]", "fuzzy_pid.rules.kp=B S"),
        *("disturbance.pulse.channel=knee", "recorder.output=a.mcap", "fuzzy_pid.update_rate=1ms"),
    ):
        yield Case("setting", ("--set", setting))
    for option, value in (
        *(("--at", v) for v in ("", "now", "nan", "-1", "1e9", "1kg")),
        *(("--duration", v) for v in ("", "abc", "nan", "-1", "1e99", "inf", "5kg")),
        *(("--rate", v) for v in ("", "abc", "0", "-5", "nan", "1e99", "7m")),
        *(("--controller", v) for v in ("", "pdi", "PID", "fuzzypid", "fuzzy-pid", "a,b")),
        *(("--params", v) for v in ("", "nosuch.yaml", "a.mcap", "pid_as_printd", "bad.yaml")),
        *(("--swap-at", v) for v in ("", "3", "3:", ":pid", "3:pdi", "-1:pid", "nan:pid", "pid:3")),
        *(("--seed", v) for v in ("", "-1", "abc", "1.5")),
        *(("--workers", v) for v in ("", "-1", "many")),
        *(("--metric", v) for v in ("", "overshot", "IAE")),
        *(("--run", v) for v in ("", "-1", "abc")),
    ):
        yield Case("value", (option, value))


def cases() -> list[Case]:
    """Return all cases, each once."""
    found = [*_typos(), *_inputs(), *_outputs(), *_values()]
    return list(dict.fromkeys(found))


_CPU_S = 60  # of one case: what takes longer was begun, not refused
State = dict[str, tuple[int, int, int]]

# Besides an error: warnings and progress.
_ASIDE = re.compile(r"warning: |^trunk: [^:]+: \d+ %")
# Listing the whole machine's files is not a case.
_TOO_MANY = ("list runs", "/")
# Folders that can be made.
_NEW = ("x", "x.", ".x", "x.txt", "x.mcap.bak", "x.MCAP2")
# Right for these verbs, though careless for others: (verb, argument).
FINE = {
    *(("list runs", place) for place in (".", "..", "folder", "hollow", "two", "~")),
    *(("params show", file) for file in ("params.yaml", "yaml.mcap")),
    *(("study compare", file) for file in ("swept.parquet", "parquet.mcap")),
    *(("paper -o made", place) for place in (*_NEW, "folder")),
    *product(
        ("export-c -o c", "branch --at 0.1"),  # both write into a folder
        (*_NEW, " ", "no/such/folder/x", "-oo", "-ojson", "--force"),
    ),
    *(("export-c -o c", name) for name in ("{input}", "pid")),
}


def words_of(verb: Verb, case: Case) -> tuple[str, ...]:
    """Return the command line of a case."""
    inputs = () if case.replaces_input else verb.inputs
    names = {
        "{input}": verb.inputs[0] if verb.inputs else "a.mcap",
        "{kept}": f"kept{verb.suffix or '.mcap'}",
    }
    return (*verb.words, *inputs, *(names.get(one, one) for one in case.arguments))


def state_of(folder: Path) -> State:
    """Return size, time of change and inode of every file."""
    found = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        found[str(path.relative_to(folder))] = status.st_size, status.st_mtime_ns, status.st_ino
    return found


def clean(folder: Path, before: State) -> None:
    """Remove what a case has made."""
    for path in sorted(folder.rglob("*"), reverse=True):
        if str(path.relative_to(folder)) not in before:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()


def complaint(
    verb: Verb, case: Case, outcome: limited.Outcome, changed: list[str], before: State
) -> str:
    """Return what is wrong with how a case ended; empty if nothing."""
    lines = outcome.err.splitlines()
    lost = [name for name in changed if name in before]
    if lost and not all((Path(name).is_dir() and not Path(name).is_symlink()) for name in lost):
        return f"changed {', '.join(lost)}"
    if outcome.verdict in (limited.TIME_OUT, limited.TRACEBACK) or "Traceback" in outcome.out:
        return f"{outcome.verdict}, {outcome.code}"
    if outcome.code != 0:
        if changed:
            return f"left {', '.join(changed)}"
        errors = [line for line in lines if not _ASIDE.search(line)]
        answered = outcome.code in (1, 2) and outcome.out and not errors  # a verdict, on stdout
        if len(errors) != 1 and not answered:
            return f"{len(errors)} lines"
        return ""
    argument = case.arguments[-1] if case.arguments else ""
    if lines or (verb.name, argument) in FINE:
        return ""
    return "nothing said"


def main() -> int:
    """Run the cases; return 1 if any is not as it should be."""
    words = sys.argv[1:]
    every = 1
    if words[:1] == ["--every"]:
        every, words = int(words[1]), words[2:]
    verbs = [verb for verb in VERBS if not words or verb.name in words]
    counts: Counter[str] = Counter()
    here = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="trunk-bad-arguments-") as place:
        folder = Path(place) / "folder"
        folder.mkdir()
        furnish(folder)
        os.chdir(folder)
        for verb in verbs:  # import what the verbs need, once
            limited.run((*verb.words, "--help"), folder.parent, _CPU_S, RLIM_INFINITY)
        before = state_of(folder)
        number = 0
        for verb in verbs:
            for case in cases():
                number += 1
                if number % every or (verb.name, *case.arguments) == _TOO_MANY:
                    continue
                words_ = words_of(verb, case)
                outcome = limited.run(words_, folder.parent, _CPU_S, RLIM_INFINITY)
                after = state_of(folder)
                changed = sorted(
                    name for name in {*before, *after} if before.get(name) != after.get(name)
                )
                counts["cases"] += 1
                wrong = complaint(verb, case, outcome, changed, before)
                if wrong:
                    counts["wrong"] += 1
                    said = " | ".join(outcome.err.splitlines()[-2:])[:200]
                    print(
                        f"{wrong}: trunk {' '.join(map(repr, words_))}: exit {outcome.code}: {said}"
                    )
                clean(folder, before)
                if any(name in before for name in changed):
                    before = state_of(folder)
        os.chdir(here)
    print(f"{counts['cases']} cases of {len(verbs)} verbs, {counts['wrong']} wrong")
    return 1 if counts["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
