"""The test files that a change concerns: those that import a changed file, directly or not, or name it.

source scripts/env.sh && python -m tests.needed [FILE ...]

Without files: those that differ from the last commit; if none does, those of the last commit. A law is found
by its entry point, not by an import: what any law does, the shares of seeds and of the same bits test.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
_IMPORT = re.compile(r"(?m)^\s*(?:from\s+(\.*)([\w.]*)\s+)?import\s+(\([^)]*\)|.*)")


def changed() -> set[Path]:
    """Return what differs from the last commit, else what it changed itself."""
    for words in (("diff", "--name-only", "HEAD"), ("diff", "--name-only", "HEAD~1", "HEAD")):
        command = ["git", "-C", str(ROOT), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if names := done.stdout.split("\n")[:-1]:
            return {ROOT / name for name in names}
    return set()


def imported(file: Path, text: str, files: dict[str, Path]) -> set[Path]:
    """Return the files, by their modules' names, that a file imports anywhere in it."""
    modules = set()
    for dots, base, names in _IMPORT.findall(text):
        up = list(file.relative_to(ROOT).with_suffix("").parts[: -len(dots)]) if dots else []
        stem = ".".join([*up, *([base] if base else [])])
        modules |= {stem, *(f"{stem}.{name}".lstrip(".") for name in re.findall(r"[\w.]+", names))}
    return {files[module] for module in modules & set(files)}


def needed(of: set[Path]) -> set[Path]:
    """Return the test files that import one of these, directly or not, or name one that is not Python."""
    paths = [*ROOT.glob("ros2_ws/src/**/*.py"), *ROOT.glob("tests/**/*.py")]
    files: dict[str, Path] = {}
    for path in paths:
        parts = path.relative_to(ROOT).with_suffix("").parts
        for name in (parts, parts[3:] if parts[0] == "ros2_ws" else parts):
            files[".".join(name).removesuffix(".__init__")] = path
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    others = {path for path in of if path.suffix != ".py"}
    names = {'"docs"' if path.parent.name == "docs" else path.name for path in others}
    reached = of | {path for path, text in texts.items() if any(name in text for name in names)}
    uses = {path: imported(path, text, files) for path, text in texts.items()}
    while more := {path for path, used in uses.items() if used & reached} - reached:
        reached |= more
    return {path for path in reached & set(paths) if path.name.startswith("test_")}


if __name__ == "__main__":
    given = {Path(name).resolve() for name in sys.argv[1:]} or changed()
    print(*sorted(str(path.relative_to(ROOT)) for path in needed(given)), sep="\n")
