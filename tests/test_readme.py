"""README.md and the pages: tables as declared, links that lead somewhere, and who each page is for."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from trunk_experiments.analysis.metrics import QUANTITIES
from trunk_experiments.templates import controller_package
from trunk_msgs_util import topics

from .finished import finished
from .graph.conftest import domain, domains

__all__ = ["domain", "domains"]

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, *sorted(ROOT.glob("docs/*.md")), ROOT / "docker" / "README.md"]
OTHERS = [ROOT / name for name in ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")]
LINK = re.compile(r"\]\(([^)\s]+)\)")


def text_of(page):
    return page.read_text(encoding="utf-8")


def test_the_page_lists_each_topic():
    listed = dict(re.findall(r"^\| `(\S+)` \| (\S+) \|", text_of(ROOT / "docs/concepts.md"), re.M))
    others = {"CONTROLLER/reference", "CONTROLLER/state", "/clock", "/diagnostics"}
    assert listed.keys() == others | {
        value.replace("~", "CONTROLLER")
        for name, value in vars(topics).items()
        if name.isupper() and isinstance(value, str) and not name.endswith(("_TYPE", "_NODE"))
        if value not in (topics.EXTERNAL, topics.REAL_TIME, *topics.PICTURES)
    }
    for name, kind in topics.evidence_types(("CONTROLLER",), topics.REAL_TIME).items():
        assert listed[name] == kind.replace("/msg/", "/")


def test_each_metric_is_defined_as_in_the_code():
    page = text_of(ROOT / "docs" / "metrics.md")
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| (.+) \|$", page, re.MULTILINE)
    assert [(name, unit, meaning.replace(r"\|", "|")) for name, unit, meaning in rows] == [
        (name, quantity.unit, quantity.meaning) for name, quantity in QUANTITIES.items()
    ]


@pytest.mark.parametrize("page", [*PAGES, *OTHERS], ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_says_first_who_it_is_for(page):
    paragraphs = [
        part for part in text_of(page).split("\n\n") if not part.startswith(("    ", "#"))
    ]
    assert re.match(r"For anyone (who|in|with)\b", paragraphs[0]), paragraphs[0]


def test_the_page_on_controllers_shows_the_law_that_trunk_writes(tmp_path):
    written = {path.name: path for path in controller_package("my_controller", tmp_path)}
    page = text_of(ROOT / "docs" / "controllers.md")
    shown = page.partition("```python\n")[2].partition("```")[0]
    assert ast.dump(ast.parse(shown)) == ast.dump(ast.parse(text_of(written["law.py"])))


def headings(page):
    """Return the anchors of a page's headings, as GitHub and MkDocs make them."""
    text = re.sub(r"^```.*?^```", "", text_of(page), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", [*PAGES, *OTHERS], ids=lambda page: str(page.relative_to(ROOT)))
def test_no_link_leads_nowhere(page):
    for link in LINK.findall(text_of(page)):
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in headings(target), link


def test_the_readme_is_short():
    assert len(text_of(README).splitlines()) <= 110


def block(language):
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", text_of(README), re.DOTALL | re.MULTILINE)
    return found


@pytest.mark.graph
@pytest.mark.slow
def test_the_examples_run_as_printed(tmp_path, domain):
    """As in a fresh clone: nothing is there but the scripts and the examples."""
    for folder in ("scripts", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    python = (
        f"cat > example.py <<'END'\n{block('python')}END\npython example.py\npython example.py\n"
    )
    done = finished(["bash", "-ec", block("bash") + python], cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical: 10006 messages, bit for bit" in done.stdout
    assert "fuzzy.mcap: verified" in done.stdout
    made = {path.name for path in tmp_path.iterdir()}
    assert {"report.html", "what_if.mcap", "lqr.yaml", "lqr.mcap", "fig8.png"} <= made
