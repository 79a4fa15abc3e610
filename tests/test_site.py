"""The site of docs/: scripts/docs.sh builds it without a warning; it asks no other host for anything."""

import os
import re
from pathlib import Path

import pytest
from ros2_ws.src.trunk_experiments.test.documents import VERBS, documents_of

import trunk_experiments.api as trunk
from trunk_core.parameters.declarations import declarations
from trunk_runs.nodes import NODES
from trunk_runs.scenario import shipped_files

from .finished import finished

ROOT = Path(__file__).parents[1]
RESOURCE = re.compile(r"<(?:script|link|img|iframe|source)\b[^>]*?\b(?:src|href)=\"?([^\"\s>]+)")
BROKEN = {
    "[page](nowhere.md)": "'nowhere.md'",
    "[heading](start.md#nowhere)": "'start.md#nowhere'",
    "[file](../scripts/nowhere.sh)": "'../scripts/nowhere.sh'",
    "`scripts/nowhere.py`": "`scripts/nowhere.py`, which does not exist",
    "`trunk_sim/nowhere.py`": "`trunk_sim/nowhere.py`, which does not exist",
}
LAB = "<!DOCTYPE html><title>fig6, a lab</title>"
SMALL = (
    *("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"),
    *("docker/README.md", "examples/ros2_control/README.md"),
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built") / "site"
    labs = tmp_path_factory.mktemp("labs")
    (labs / "fig6.html").write_text(LAB)
    done = finished(
        ["bash", ROOT / "scripts" / "docs.sh", folder], env={**os.environ, "TRUNK_LABS": str(labs)}
    )
    if done.returncode == 2:
        pytest.skip("the site of docs/: scripts/docs.sh installs MkDocs from the network")
    assert done.returncode == 0, done.stderr
    others = ("docs: installing", "bootstrap: ")
    said = [line for line in done.stderr.splitlines() if not line.startswith(others)]
    assert said == []
    return folder


@pytest.mark.one_in(4)
def test_each_page_is_there_and_asks_no_other_host_for_anything(site):
    pages = {page.stem for page in (ROOT / "docs").glob("*.md")}
    assert pages <= {page.stem for page in site.glob("*.html")}
    for page in site.glob("*.html"):
        wanted = RESOURCE.findall(page.read_text(encoding="utf-8"))
        assert wanted
        assert [link for link in wanted if re.match(r"\w+:|//", link)] == [], page.name
    for style in site.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", style.read_text("utf-8"))


def test_the_site_has_the_tables_that_the_repository_has_not(site):
    pages = {
        name: (site / f"{name}.html").read_text(encoding="utf-8")
        for name in ("parameters", "metrics", "api", "plant")
    }
    names = {name for kind in NODES.values() for name in declarations(kind.config)}
    for name in (*names, *shipped_files()):
        assert f"<td><code>{name}</code>" in pages["parameters"], name
    for words, verb in VERBS.items():
        (documents,) = documents_of(verb)
        row = f"<td><code>{' '.join(('trunk', *words))}</code></td>"
        cell = pages["metrics"].partition(row)[2].partition("</tr>")[0]
        assert re.findall(r"<code>([\w-]+)</code>", cell) == list(documents), words
    assert "CartPoleConfig" in pages["plant"]
    for name in trunk.__all__:
        assert f'id="trunk_experiments.api.{name}"' in pages["api"], name


def test_the_site_has_the_labs_that_were_made(site):
    assert (site / "labs" / "fig6.html").read_text() == LAB
    links = re.findall(r'href="?(labs/[^">\s]+)', (site / "lab.html").read_text(encoding="utf-8"))
    assert links == ["labs/fig6.html"]


def test_broken_links_are_refused(site, tmp_path):
    for name in ("mkdocs.yml", "scripts/docs_site.py", "docs/site.css"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        text = (ROOT / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(text.split("\nnav:\n")[0], encoding="utf-8")
    for name in SMALL:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("# A page\n", encoding="utf-8")
    page = "# Start\n\n" + "\n\n".join(BROKEN)
    (tmp_path / "docs" / "start.md").write_text(page, encoding="utf-8")
    python = ROOT / ".venv" / ".docs" / "bin" / "python"
    done = finished([python, "-I", "-m", "mkdocs", "build", "--strict"], cwd=tmp_path)
    assert done.returncode == 1
    for text in BROKEN.values():
        assert text in done.stderr, done.stderr
