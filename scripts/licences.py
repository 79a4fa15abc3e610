"""Check the licence of every installed package that requirements/ names, against requirements/licences.yaml.

licences.py [--table]     one line with the numbers, or the whole report as a Markdown table

Exit code 1 and one line for each package whose licence is unknown or not allowed.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

REQUIREMENTS = Path(__file__).parents[1] / "requirements"
RUNNING = "runtime", "ros", "cluster", "gym", "notebook"
TOOLS = "setuptools", "build", "lab", "dev"
ON_REQUEST = ("fuzzy",)
_KEYS = {"allowed", "tools", "on_request", "names", "by_hand"}


class Known(NamedTuple):
    """What requirements/licences.yaml says; `by_hand`: package -> (licence, where it was read)."""

    allowed: frozenset[str]
    tools: frozenset[str]
    on_request: frozenset[str]
    names: dict[str, str]
    by_hand: dict[str, tuple[str, str]]


class Package(NamedTuple):
    """One line of the report; `licence` is None where nothing is known."""

    name: str
    version: str
    licence: str | None
    source: str


def normal(name: str) -> str:
    """Return a distribution's name as in requirements/*.txt: lower case, hyphens (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def locked(text: str) -> dict[str, str]:
    """Return name -> version of a requirement file's text."""
    return {normal(n): v for n, v in re.findall(r"^([\w.-]+)==([^\s;\\]+)", text, re.MULTILINE)}


def known(text: str) -> Known:
    """Read licences.yaml. Raises ValueError for a wrong layout or a package that is listed twice."""
    data = yaml.safe_load(text)
    if not isinstance(data, dict) or set(data) != _KEYS:
        raise ValueError(f"must have exactly the keys {', '.join(sorted(_KEYS))}")
    by_hand: dict[str, tuple[str, str]] = {}
    for group in data["by_hand"]:
        if not isinstance(group, dict) or set(group) != {"licence", "source", "packages"}:
            raise ValueError(f"by_hand: needs licence, source and packages, has {group!r}")
        for package in group["packages"]:
            if package in by_hand:
                raise ValueError(f"by_hand: {package} is listed twice")
            by_hand[package] = (group["licence"], group["source"])
    groups = (frozenset(data[key]) for key in ("allowed", "tools", "on_request"))
    return Known(*groups, data["names"], by_hand)


def declared(found: Mapping[str, str], knowledge: Known) -> str | None:
    """Return the one SPDX expression that a package declares (as pip-licenses found it), else None.

    Its License-Expression; else its License; else its only classifier: the latter two where they are
    an identifier or name in licences.yaml.
    """
    if (expression := found["License-Expression"]) != "UNKNOWN":
        return expression
    identifiers = knowledge.allowed | knowledge.tools | set(knowledge.names.values())
    classifiers = set(found["License-Classifier"].split("; ")) - {"DFSG approved"}
    for texts in ({found["License-Metadata"]}, classifiers):
        meant = {knowledge.names.get(text, text) for text in texts}
        if len(meant) == 1 and meant <= identifiers:
            return meant.pop()
    return None


def permitted(expression: str, licences: Collection[str]) -> bool:
    """Return whether all licences of an expression (of one side of an OR) are among `licences`.

    AND binds closer than OR; an expression with parentheses has to be listed as it is.
    """
    if "(" in expression:
        return expression in licences
    sides = (side.split(" AND ") for side in expression.split(" OR "))
    return any(all(licence in licences for licence in side) for side in sides)


def report(found: list[dict[str, str]], knowledge: Known) -> list[Package]:
    """Return the packages with their licences, ordered by name."""
    packages = []
    for one in found:
        name = normal(one["Name"])
        licence, source = declared(one, knowledge), "declared"
        if licence is None:
            licence, source = knowledge.by_hand.get(name, (None, "nothing"))
        packages.append(Package(name, one["Version"], licence, source))
    return sorted(packages)


def faults(
    packages: list[Package],
    running: Collection[str],
    tools: Collection[str],
    knowledge: Known,
    on_request: Collection[str] = (),
) -> list[str]:
    """Return a line for each package that is not allowed, and for each needless entry by hand."""
    lines = []
    for name, version, licence, source in packages:
        allowed = knowledge.allowed | (frozenset() if name in running else knowledge.tools)
        if name in on_request:
            allowed |= knowledge.on_request
        if licence is None:
            lines.append(
                f"{name} {version}: declares no licence, or an ambiguous one: list it in by_hand"
            )
        elif not permitted(licence, allowed):
            use = "what runs" if name in running else "tools"
            lines.append(
                f"{name} {version}: {licence} is not allowed for {use}: remove it, or allow it"
            )
        if source == "declared" and name in knowledge.by_hand:
            lines.append(f"{name} {version}: declares {licence} itself: remove it from by_hand")
    gone = sorted(set(knowledge.by_hand) - set(running) - set(tools) - set(on_request))
    lines += [f"{name}: by_hand lists it, requirements/*.txt do not: remove it" for name in gone]
    return lines


def installed(names: Collection[str]) -> list[dict[str, str]]:
    """Return what pip-licenses finds out about the packages in this environment."""
    command = [sys.executable, "-m", "piplicenses", "--format=json", "--from=all", "--with-system"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return [one for one in found if normal(one["Name"]) in names]


def names_in(sets: Collection[str]) -> set[str]:
    """Return the names of all packages in some requirement files."""
    return {
        name for one in sets for name in locked((REQUIREMENTS / f"{one}.txt").read_text("utf-8"))
    }


def main(arguments: list[str]) -> int:
    if arguments not in ([], ["--table"]):
        print(
            f"licences: unknown argument {arguments[0]!r}: --table is the only option",
            file=sys.stderr,
        )
        return 2
    try:
        knowledge = known((REQUIREMENTS / "licences.yaml").read_text(encoding="utf-8"))
    except (ValueError, KeyError, TypeError, yaml.YAMLError) as error:
        print(f"requirements/licences.yaml: {str(error).splitlines()[0]}", file=sys.stderr)
        return 1
    running, tools, on_request = map(names_in, (RUNNING, TOOLS, ON_REQUEST))
    packages = report(installed(running | tools | on_request), knowledge)
    if arguments:
        print("| package | version | licence | known from |\n|---|---|---|---|")
        for package in packages:
            print(f"| {' | '.join(str(cell) for cell in package)} |")
    else:
        count = Counter(package.licence for package in packages)
        by_hand = sum(package.source not in ("declared", "nothing") for package in packages)
        text = ", ".join(f"{number} {licence}" for licence, number in count.most_common())
        print(f"licences of {len(packages)} packages, {by_hand} known by hand: {text}")
    wrong = faults(packages, running, tools, knowledge, on_request)
    for line in wrong:
        print(f"licences: {line} (requirements/licences.yaml)", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
