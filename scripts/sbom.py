"""Make the bill of materials of what runs from the one that cyclonedx-py makes of .venv; see sbom.sh.

sbom.py ENVIRONMENT.json > SBOM.json      run by .venv's interpreter

Kept are the packages of requirements/runtime.txt and ros.txt. Added are the hashes that pip accepts for each,
licences known by hand, and the libraries that a wheel bundles. The same environment gives the same bytes.
"""

from __future__ import annotations

import base64
import json
import platform
import re
import sys
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml
from licences import REQUIREMENTS, Package, installed, known, normal, report
from packaging.requirements import Requirement

SETS = "runtime", "ros"
_LOCKED = re.compile(
    r"^([\w.-]+==[^\\\n]+?)\s*\\\n((?:\s+--hash=sha256:\w+\s*\\?\n)+)", re.MULTILINE
)
Json = dict[str, Any]


def hashes(text: str) -> dict[str, tuple[str, list[str]]]:
    """Return name -> (version, SHA-256 of its files) of what a lock installs on this machine."""
    found = {}
    for line, block in _LOCKED.findall(text):
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate():
            version = str(requirement.specifier).removeprefix("==")
            found[normal(requirement.name)] = version, re.findall(r"sha256:(\w+)", block)
    return found


def licence_entries(package: Package) -> list[Json]:
    """Return a component's `licenses`: one identifier, or one SPDX expression."""
    if package.licence is None:
        return []
    known_from = "declared" if package.source == "declared" else "concluded"
    if re.search(r" (AND|OR|WITH) ", package.licence):
        return [{"expression": package.licence, "acknowledgement": known_from}]
    return [{"license": {"id": package.licence, "acknowledgement": known_from}}]


def bundled(name: str) -> list[Json]:
    """Return the third-party shared libraries that an installed wheel bundles in its folder *.libs."""
    files = [f for f in metadata.files(name) or [] if f.parts[0].endswith(".libs") and f.hash]
    return [
        {
            "type": "file",
            "bom-ref": f"{normal(name)}/{file.name}",
            "name": file.name,
            "hashes": [
                {
                    "alg": "SHA-256",
                    "content": base64.urlsafe_b64decode(file.hash.value + "==").hex(),
                }
            ],
        }
        for file in sorted(files)
        if file.hash
    ]


def completed(
    found: Json, locked: tuple[str, list[str]], package: Package, libraries: list[Json]
) -> Json:
    """Return a component with all that is added. Raises ValueError for another version."""
    version, digests = locked
    if found["version"] != version:
        raise ValueError(
            f"{package.name} {found['version']} is installed, requirements/ pin {version}"
        )
    component = {**found, "licenses": licence_entries(package)}
    component["externalReferences"] = [
        *found.get("externalReferences", []),
        {
            "type": "distribution",
            "url": found["purl"],
            "comment": "pip accepts a file with any one of these hashes",
            "hashes": [{"alg": "SHA-256", "content": digest} for digest in digests],
        },
    ]
    if libraries:
        component["components"] = libraries
    return component


def sbom(
    environment: Json,
    locked: Mapping[str, tuple[str, list[str]]],
    packages: Mapping[str, Package],
    direct: set[str],
    version: str,
) -> Json:
    """Return the bill of materials; `direct`: the names in requirements/*.in.

    Raises ValueError for a requirement that is not installed, or not as it is locked.
    """
    found = {normal(one["name"]): one for one in environment["components"]}
    if missing := sorted(set(locked) - set(found)):
        raise ValueError(f"not installed: {', '.join(missing)}; run scripts/bootstrap.sh")
    components = [
        completed(found[name], locked[name], packages[name], bundled(name))
        for name in sorted(locked)
    ]
    refs = {found[name]["bom-ref"] for name in locked}
    depends = [
        {**one, "dependsOn": [ref for ref in one.get("dependsOn", []) if ref in refs]}
        for one in environment["dependencies"]
        if one["ref"] in refs
    ]
    root = {"ref": "trunk", "dependsOn": sorted(found[name]["bom-ref"] for name in direct)}
    about = {
        **environment["metadata"],
        "component": {
            "type": "application",
            "bom-ref": "trunk",
            "name": "trunk",
            "version": version,
            "licenses": [{"license": {"id": "Apache-2.0"}}],
        },
    }
    python = f"{platform.python_implementation()} {platform.python_version()}"
    about["properties"] = [
        *about.get("properties", []),
        {"name": "trunk:environment", "value": f"{python}, {sys.platform} {platform.machine()}"},
    ]
    return {
        **environment,
        "metadata": about,
        "components": components,
        "dependencies": [root, *depends],
    }


def named(text: str) -> set[str]:
    """Return the names of the packages in the text of a *.in file."""
    lines = (line for line in text.splitlines() if re.match(r"[A-Za-z0-9]", line))
    return {normal(Requirement(line).name) for line in lines}


def main(file: str) -> int:
    texts = [(REQUIREMENTS / f"{one}.txt").read_text(encoding="utf-8") for one in SETS]
    locked = {name: one for text in texts for name, one in hashes(text).items()}
    knowledge = known((REQUIREMENTS / "licences.yaml").read_text(encoding="utf-8"))
    packages = {one.name: one for one in report(installed(locked), knowledge)}
    ours = REQUIREMENTS.parent / "ros2_ws" / "src" / "trunk_experiments" / "package.xml"
    direct = {
        name for one in SETS for name in named((REQUIREMENTS / f"{one}.in").read_text("utf-8"))
    }
    try:
        environment = json.loads(Path(file).read_text(encoding="utf-8"))
        made = sbom(
            environment,
            locked,
            packages,
            direct,
            ElementTree.parse(ours).findtext("version", ""),
        )
    except (ValueError, yaml.YAMLError) as error:
        print(f"sbom: {error}", file=sys.stderr)
        return 1
    print(json.dumps(made, indent=2, sort_keys=True, ensure_ascii=False))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
