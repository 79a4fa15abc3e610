"""README.md and the pages: tables as declared, examples as they are; scripts/docs.sh checks their links."""

import ast
import re
from pathlib import Path

import pytest

from trunk_core import topics
from trunk_evidence.run_metrics import QUANTITIES
from trunk_experiments.console.own_packages import controller_package

from .finished import finished
from .graph.conftest import domain, domains

__all__ = ["domain", "domains"]

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


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


def test_the_page_on_controllers_shows_the_law_that_trunk_writes(tmp_path):
    written = {path.name: path for path in controller_package("my_controller", tmp_path)}
    page = text_of(ROOT / "docs" / "controllers.md")
    shown = page.partition("```python\n")[2].partition("```")[0]
    assert ast.dump(ast.parse(shown)) == ast.dump(ast.parse(text_of(written["law.py"])))


def test_examples_of_json_follow_their_schemas():
    from ros2_ws.src.trunk_experiments.test.documents import checked, strict

    examples = re.findall(r"^```json\n(.*?)^```", text_of(ROOT / "docs/metrics.md"), re.M | re.S)
    names = [strict(text)["schema"].removeprefix("trunk/") for text in examples]
    assert names == ["metrics-1", "error-1"]
    for text, name in zip(examples, names, strict=True):
        checked(text, name)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="git, in a checkout")
def test_git_ignores_what_the_pages_let_their_readers_create():
    made = {
        "allowed_signers",
        "fig8.mcap.sig",
        "trunk_20260101T000000Z.mcap",
        "fig8.html",
        "params.yaml",
    }
    elsewhere = (
        "controllers",
        "plant",
        "rules",
        "tuning",
        "tutorial",
    )  # in a folder of the reader's
    for page in (README, *ROOT.glob("docs/*.md")):
        if page.stem in elsewhere:
            continue
        made |= set(re.findall(r"(?:-o|--output)[ =](?![A-Z]+\b|/)([\w./-]*\w)", text_of(page)))
    assert {"fig8.mcap", "lqr.yaml"} <= made
    ignored = finished(["git", "check-ignore", "--", *made], cwd=ROOT).stdout.split()
    assert made - {*ignored} == set()


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
