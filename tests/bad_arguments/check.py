"""Every verb with every bad argument: an error or a warning in one line, and nothing lost on disk.

    python -m tests.bad_arguments.check [--every N] [VERB...]

``--every N``: only every Nth case, for CI. Each case runs in a process forked from this one, which has
imported the verbs already.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import NamedTuple

from .arguments import Case, cases
from .verbs import VERBS, Verb, called, furnish

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
    *(("study compare", file) for file in ("study.parquet", "parquet.mcap")),
    *(("paper", place) for place in (*_NEW, "folder")),
    *product(
        ("export-c -o c", "branch --at 0.1"),  # both write into a folder
        (*_NEW, " ", "no/such/folder/x", "-oo", "-ojson", "--force"),
    ),
    *(("export-c -o c", name) for name in ("{input}", "pid")),
}


class Outcome(NamedTuple):
    """How a case ended."""

    code: int
    said: str
    told: str  # on stderr
    changed: list[str]


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


def outcome_of(words: tuple[str, ...], folder: Path, before: State) -> Outcome:
    """Run a case in its own process."""
    out, err = (folder.parent / name for name in ("out", "err"))
    child = os.fork()
    if child == 0:
        with suppress(BaseException):
            resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S))
            for number, path in ((1, out), (2, err)):
                os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            code = called(words)
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        os._exit(99)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    after = state_of(folder)
    names = {*before, *after}
    changed = sorted(name for name in names if before.get(name) != after.get(name))
    return Outcome(code, out.read_text(errors="replace"), err.read_text(errors="replace"), changed)


def clean(folder: Path, before: State) -> None:
    """Remove what a case has made."""
    for path in sorted(folder.rglob("*"), reverse=True):
        if str(path.relative_to(folder)) not in before:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()


def complaint(verb: Verb, case: Case, outcome: Outcome, before: State) -> str:
    """Return what is wrong with how a case ended; empty if nothing."""
    lines = outcome.told.splitlines()
    lost = [name for name in outcome.changed if name in before]
    if lost and not all((Path(name).is_dir() and not Path(name).is_symlink()) for name in lost):
        return f"changed {', '.join(lost)}"
    if "Traceback" in outcome.told + outcome.said or outcome.code in (99, -signal.SIGXCPU):
        return f"failed with {outcome.code}"
    if outcome.code < 0:
        return f"ended by signal {-outcome.code}"
    if outcome.code != 0:
        if outcome.changed:
            return f"left {', '.join(outcome.changed)}"
        errors = [line for line in lines if not _ASIDE.search(line)]
        answered = outcome.code in (1, 2) and outcome.said and not errors  # a verdict, on stdout
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
        for verb in verbs:  # import what the verbs need, once
            outcome_of((*verb.words, "--help"), folder, {})
        before = state_of(folder)
        number = 0
        for verb in verbs:
            for case in cases():
                number += 1
                if number % every or (verb.name, *case.arguments) == _TOO_MANY:
                    continue
                words_ = words_of(verb, case)
                outcome = outcome_of(words_, folder, before)
                counts["cases"] += 1
                wrong = complaint(verb, case, outcome, before)
                if wrong:
                    counts["wrong"] += 1
                    said = " | ".join(outcome.told.splitlines()[-2:])[:200]
                    print(
                        f"{wrong}: trunk {' '.join(map(repr, words_))}: exit {outcome.code}: {said}"
                    )
                clean(folder, before)
                if any(name in before for name in outcome.changed):
                    before = state_of(folder)
        os.chdir(here)
    print(f"{counts['cases']} cases of {len(verbs)} verbs, {counts['wrong']} wrong")
    return 1 if counts["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
