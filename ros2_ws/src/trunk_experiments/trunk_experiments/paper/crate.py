"""The reproduction as an RO-Crate: a folder from which a reviewer can check it and run it again.

Recordings are verified before they are described, by `crate_metadata`, and by `checklist` in prose.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from datetime import datetime, timezone
from hashlib import sha256
from importlib.metadata import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from trunk_msgs_util import provenance
from trunk_msgs_util.files import atomic_write
from trunk_msgs_util.provenance import NONE
from trunk_msgs_util.recording.reader import Recording

from ..errors import CrateError, NotInstalledError
from ..plans.files import find_file
from ..replay.verify import verify
from .reproduction import Reproduction, Say
from .runs import CONTENDERS, FIGURES, PROFILES, Case, Runs

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


_TO_FILL_IN = """\
# CODECHECK's configuration, https://codecheck.org.uk/spec/config/1.0/
# The project has filled in what it knows. The codechecker adds `codechecker` (name, ORCID), `report` (DOI),
# `check_time` and `certificate`; the paper's `authors` and `reference` are on its own title page.
"""


def codecheck(paper: str) -> str:
    """Return ``codecheck.yml``: the manifest of outputs. What only a codechecker knows is left out."""
    report = {
        "report.html": "Every claim with its verdict, every figure, all numbers, the errata.",
        "paper.json": "The same for programs: .claims[].offline.verdict, .runs[].metrics.",
    }
    figures = {
        f"{figure}.png": f"Figure {figure.removeprefix('fig')} of the paper, by our runs in runs/."
        for figure in FIGURES
    }
    manifest = [{"file": name, "comment": text} for name, text in {**report, **figures}.items()]
    data = {
        "version": "https://codecheck.org.uk/spec/config/1.0/",
        "source": "README.md says how to run it again and how to compare.",
        "paper": {"title": paper},
        "manifest": manifest,
    }
    return _TO_FILL_IN + "---\n" + yaml.safe_dump(data, sort_keys=False, width=100)


def read_me(paper: str, about: Mapping[str, str], recordings: int, graph: bool) -> str:
    """Return ``README.md``: how to check the crate and how to run it again."""
    commit = about["commit"]
    code = f"commit `{commit}`" if commit != NONE else "not from a git checkout: no commit is known"
    if commit.endswith("+dirty"):
        code += ", with changes that no commit has: another checkout may give other numbers"
    option = " --graph" if graph else ""
    loop = "runs/*.mcap graph/*/run.mcap" if graph else "runs/*.mcap"
    return f"""\
# The paper, reproduced and judged: for a reviewer

This folder is an [RO-Crate](https://w3id.org/ro/crate/1.1): `ro-crate-metadata.json` names every file
with its SHA-256. The paper is *{paper}*;
it is not in here. `report.html` is the result, to be read in a browser.

Made by `trunk paper{option} --crate` of trunk {about["trunk_experiments"]} ({code})
with {about["python"]}, from {about["started_utc"]} to {about["ended_utc"]}.
`provenance.json` has the versions of all libraries that matter.

## Check what is here

    for run in {loop}; do trunk verify "$run" || break; done

recomputes every command and every state of the {recordings} recordings from the parameters in them. All of
them verified when this folder was made. That shows that the runs follow from the equations in the code;
whether these are the paper's is what the report argues.

## Run it again

    trunk paper{option} -o again --crate
    for run in runs/*.mcap; do trunk diff "$run" "again/$run" || break; done

The recordings have the same messages, bit for bit, on every machine. Only their times and names of machines
differ, so compare with `trunk diff`, not by hash. Figures may differ by a pixel with another matplotlib.
`parameters/` has the files that the runs read.

## Licence

Apache-2.0, code and results. `codecheck.yml` is the manifest for a [CODECHECK](https://codecheck.org.uk);
what only the codechecker knows is left open.
"""


def check_installed() -> None:
    """Refuse before any work where the library is missing. Raises NotInstalledError."""
    if find_spec("rocrate") is None:
        raise NotInstalledError("--crate needs rocrate: pip install rocrate")


def write_crate(result: Reproduction, folder: Path, begun: Mapping[str, str], say: Say) -> Path:
    """Make a folder that `write_report` filled a crate; return its metadata's path.

    ``begun``: the provenance, gathered when the reproduction began.

    Every recording in it is verified first: raises CrateError for one that is not, and describes nothing.
    """
    recordings = _recordings(result, folder)
    about = {key: text for key, text in begun.items() if key != "host"}
    about["ended_utc"] = datetime.now(timezone.utc).isoformat(timespec="seconds")
    for number, path in enumerate(recordings, 1):
        say(f"verifying recording {number} of {len(recordings)}: {path.stem}")
        _check(path)
    read = _copy_parameters(result, folder)
    _write(folder / "provenance.json", json.dumps(about, indent=2) + "\n")
    _write(folder / "codecheck.yml", codecheck(PAPER))
    _write(folder / "README.md", read_me(PAPER, about, len(recordings), bool(result.graph)))
    made = [folder / "report.html", folder / "paper.json"]
    made += [folder / f"{figure}{suffix}" for figure in FIGURES for suffix in (".png", ".svg")]
    made += recordings
    texts = [folder / name for name in ("README.md", "codecheck.yml", "provenance.json")]
    graph = describe(folder, read, made, texts, about, result)
    path = folder / "ro-crate-metadata.json"
    _write(path, json.dumps(graph, indent=2, ensure_ascii=False) + "\n")
    return path


def _recordings(result: Reproduction, folder: Path) -> list[Path]:
    """Return the recordings of the result; a run that diverged has none that could be judged."""
    offline = [folder / "runs" / f"{case.stem}.mcap" for case in _ended(result.runs)]
    graph = [folder / "graph" / case.stem / "run.mcap" for case in _ended(result.graph)]
    return offline + graph


def _ended(runs: Runs) -> list[Case]:
    return [case for case, run in runs.items() if run.metrics is not None]


def _check(path: Path) -> None:
    verdict = verify(Recording.open(path))
    if verdict.exit_code:
        raise CrateError(
            f"{path}: {verdict.word}: only recordings that verify go into a crate: see trunk verify {path}"
        )


def _copy_parameters(result: Reproduction, folder: Path) -> list[Path]:
    """Copy the scenarios and parameter files that the runs read; return the copies."""
    used = {case.contender for case in result.runs}
    names = {*FIGURES, *PROFILES, *(n for contender in used for n in CONTENDERS[contender].params)}
    target = folder / "parameters"
    target.mkdir(exist_ok=True)
    return [
        Path(shutil.copyfile(find_file(name), target / f"{name}.yaml")) for name in sorted(names)
    ]


def _write(path: Path, text: str) -> None:
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
