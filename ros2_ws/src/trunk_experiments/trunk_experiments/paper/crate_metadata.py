"""What an RO-Crate of the reproduction says about itself, as JSON-LD.

Process Run Crate 0.5 over RO-Crate 1.1: one action, ``trunk paper``, with the code's version, the files that
it read and the files that it wrote, each with its SHA-256.
"""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import metadata
from pathlib import Path
from typing import Any

from trunk_msgs_util import provenance

from .reproduction import Reproduction

PAPER = (
    "Stabilization of Biped Trunk in the Presence of Hip Motion Disturbance "
    "Using a Fuzzy-PID Controller"
)
_LICENCE = "https://www.apache.org/licenses/LICENSE-2.0"
_PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
_FORMATS = {
    ".html": "text/html",
    ".json": "application/json",
    ".mcap": "application/octet-stream",  # it has no registered media type
    ".md": "text/markdown",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".yaml": "application/yaml",
    ".yml": "application/yaml",
}


def describe(
    folder: Path,
    read: list[Path],
    made: list[Path],
    texts: list[Path],
    about: Mapping[str, str],
    result: Reproduction,
) -> dict[str, Any]:
    """Return the crate's JSON-LD. Files are given with size and SHA-256; ``about`` is a provenance."""
    from rocrate.model import ContextEntity, SoftwareApplication
    from rocrate.rocrate import ROCrate

    crate = ROCrate(version="1.1")

    def add(key: str, kind: str, **properties: Any) -> Any:
        return crate.add(ContextEntity(crate, key, {"@type": kind, **properties}))

    def file(path: Path) -> Any:
        name = path.relative_to(folder).as_posix()
        data = path.read_bytes()
        properties = {
            "name": name,
            "description": _what(name),
            "encodingFormat": _FORMATS[path.suffix],
            "contentSize": str(len(data)),
            "sha256": sha256(data).hexdigest(),
        }
        return crate.add_file(str(path), dest_path=name, properties=properties)

    makers = add("#developers", "Organization", name=_maintainers())
    licence = add(_LICENCE, "CreativeWork", name="Apache License 2.0", identifier="Apache-2.0")
    paper = add("#paper", "ScholarlyArticle", name=PAPER)
    profile = add(_PROFILE, "CreativeWork", name="Process Run Crate", version="0.5")
    tool = crate.add(SoftwareApplication(crate, "#trunk", _software(about)))
    tool["license"], tool["creator"] = licence, makers
    inputs, outputs = [file(path) for path in read], [file(path) for path in made]
    for path in texts:
        file(path)
    action = crate.add_action(
        tool,
        "#reproduction",
        object=inputs,
        result=outputs,
        properties={
            "name": "trunk paper" + (" --graph" if result.graph else ""),
            "description": "Simulated, judged and drawn: " + _verdicts(result),
            "startTime": about["started_utc"],
            "endTime": about["ended_utc"],
            "actionStatus": "http://schema.org/CompletedActionStatus",
        },
    )
    root = crate.root_dataset
    root["name"] = f"{PAPER}: reproduced and judged"
    root["description"] = "Figures 6 to 9 of the paper by our own runs. " + _verdicts(result)
    root["datePublished"] = about["ended_utc"]
    root["license"], root["creator"], root["publisher"] = licence, makers, makers
    root["author"] = makers
    root["citation"], root["conformsTo"], root["mentions"] = paper, profile, action
    graph: dict[str, Any] = crate.metadata.generate()
    return graph


def _software(about: Mapping[str, str]) -> dict[str, Any]:
    """Return the code that ran: its version, and its commit or that none is known."""
    commit = about["commit"]
    origin = "not from a git checkout" if commit == provenance.NONE else f"commit {commit}"
    libraries = ("python", "numpy", "numba", "mcap", "rosbags")
    return {
        "name": "trunk",
        "description": f"The trunk command, {origin}; arithmetic {about['arithmetic']}.",
        "softwareVersion": about["trunk_experiments"],
        "identifier": commit,
        "softwareRequirements": [f"{name} {about[name]}" for name in libraries],
    }


def _maintainers() -> str:
    return metadata("trunk_experiments")["Maintainer"]


def _what(name: str) -> str:
    folder = name.partition("/")[0]
    texts = {
        "parameters": "Scenario or parameter file that runs read.",
        "runs": "Recording of an offline run; it verified when the crate was made.",
        "graph": "Recording of a run of the ROS 2 graph; it verified when the crate was made.",
        "report.html": "Claims, verdicts, figures, all numbers and the errata, to be read.",
        "paper.json": "The same numbers and verdicts for programs.",
        "README.md": "How to check this crate, and how to run it again.",
        "codecheck.yml": "CODECHECK's configuration: the manifest of outputs.",
        "provenance.json": "Versions of code, libraries and machine.",
    }
    return texts.get(folder, "Figure of the paper, drawn from our runs.")


def _verdicts(result: Reproduction) -> str:
    words = [offline.word for offline, _, _ in result.verdicts()]
    counts = ", ".join(f"{words.count(word)} {word}" for word in sorted(set(words)))
    return f"Of {len(words)} claims of the paper, in its own profile: {counts}."
