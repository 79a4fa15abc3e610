"""What a reviewer reads first in a crate: CODECHECK's configuration, and a README."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from trunk_msgs_util.provenance import NONE

from .runs import FIGURES

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
