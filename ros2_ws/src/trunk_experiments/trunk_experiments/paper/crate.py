"""The reproduction as an RO-Crate: a folder from which a reviewer can check it and run it again.

Recordings are verified before they are described, by `crate_metadata`, and by `checklist` in prose.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from datetime import datetime, timezone
from importlib.util import find_spec
from pathlib import Path

from trunk_msgs_util.files import atomic_write
from trunk_msgs_util.recording.reader import Recording

from ..errors import CrateError, NotInstalledError
from ..plans.files import find_file
from ..replay.verify import verify
from .checklist import codecheck, read_me
from .crate_metadata import PAPER, describe
from .reproduction import Reproduction, Say
from .runs import CONTENDERS, FIGURES, PROFILES, Case, Runs


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
