"""MkDocs' hook, for scripts/docs.sh: pages from outside docs/, links to files of the repository, tables.

What `mkdocs build --strict` cannot know is checked here: the target of a link or a path in backticks exists.
Mathematics, written as GitHub and GitLab render it, becomes MathML: no script, no fonts, no other host.
"""

from __future__ import annotations

import logging
import os
import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[1]
PAGES = {  # as they are called in the repository, and in the site
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security_policy.md",
    "docker/README.md": "docker.md",
    "examples/ros2_control/README.md": "ros2_control.md",
}
COPIES = "source"  # folder in the site with the files of the repository that pages link to

_LINK = re.compile(r"(?<=\]\()([^)#:\s]+)(?=[)#])")
_PATH = re.compile(
    r"`((?:docs|docker|examples|requirements|scripts|tests|trunk_\w+)/(?!NAME)[\w./-]+)`"
)
_DISPLAYED = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"\$`([^`]+)`\$")
_FUNCTION = re.compile(r"(<mi>(?:sin|cos)</mi>)(?!<mo stretchy=\"false\">&#x00028;)")
_MADE = re.compile(r"<!-- made with the site: (\w+) -->")
_PRIME = re.compile(r"<(msup|msubsup)>((?:(?!</?\1>).)*)<mi>(&#x0203[23];)</mi></\1>")
_LABS = {
    **{f"fig{n}": f"Fig. {n}, PID and Fuzzy-PID" for n in (6, 7, 8, 9)},
    "demo": "The run of the tutorial",
    "free": "Free: four controllers, 20 s, and only your hand disturbs",
}
_log = logging.getLogger("mkdocs.hooks.docs_site")


def in_repository(page: str, link: str) -> str:
    """Return what a link of a page means, both by their paths in the repository."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), link))


def in_site(path: str) -> str:
    """Return where a file of the repository is in the site; the pages lie side by side."""
    if path in PAGES:
        return PAGES[path]
    return path.removeprefix("docs/") if path.startswith("docs/") else f"{COPIES}/{path}"


def rewritten(page: str, text: str) -> str:
    """Return a page's text with links as the site needs them; broken ones stay, for MkDocs to refuse."""

    def link(match: re.Match[str]) -> str:
        target = in_repository(page, match[1])
        return in_site(target) if (ROOT / target).is_file() else match[1]

    return _LINK.sub(link, text)


def mathml(formula: str, display: str) -> str:
    """Return a formula in LaTeX as MathML, "inline" or as a "block"."""
    formula = formula.replace("{aligned}", "{split}")  # the converter's name for it
    # Browsers leave no space between a function and an argument without parentheses, and shrink a prime
    # that has the size of a superscript already.
    text = _FUNCTION.sub(r'\1<mspace width="0.17em"/>', convert(formula, display=display))
    return _PRIME.sub(_with_prime, text)


def _with_prime(match: re.Match[str]) -> str:
    base = match[2] if match[1] == "msup" else f"<msub>{match[2]}</msub>"
    return f'<mrow>{base}<mo lspace="0" rspace="0">{match[3]}</mo></mrow>'


def typeset(text: str) -> str:
    """Return a page's text with its mathematics as MathML."""
    text = _DISPLAYED.sub(lambda match: mathml(match[1], "block"), text)
    # In a span, as Markdown takes a line that begins with <math> for a block.
    return _INLINE.sub(lambda match: f"<span>{mathml(match[1], 'inline')}</span>", text)


def copied(page: str, text: str) -> set[str]:
    """Return the files of the repository that a page links to and that are no pages of the site."""
    targets = {in_repository(page, link) for link in _LINK.findall(text)}
    return {
        target
        for target in targets
        if target not in PAGES and not target.startswith("docs/") and (ROOT / target).is_file()
    }


def labs() -> dict[str, Path]:
    """Return the labs that were made for this site, by name."""
    folder = Path(os.environ.get("TRUNK_LABS", "no"))
    return {name: path for name in _LABS if (path := folder / f"{name}.html").is_file()}


def lab_links() -> str:
    """Return a list of the labs in this site, or that it has none."""
    if not labs():
        return "This copy of the site was built without labs: make one as follows."
    return "\n".join(f"- [{_LABS[name]}](labs/{name}.html)" for name in labs())


def made(name: str) -> str:
    """Return what the site has in place of a comment: labs, the library, or one of scripts/docs_tables.py."""
    if name == "labs":
        return lab_links()
    if name == "library":
        return "::: trunk_experiments.api"
    return (Path(os.environ["TRUNK_TABLES"]) / f"{name}.md").read_text(encoding="utf-8")


def on_files(files: Files, *, config: Any, **_: Any) -> Files:
    """Add the repository's other pages, and the files that any page links to."""
    sources = {f"docs/{file.src_uri}": file.content_string for file in files.documentation_pages()}
    for path, target in PAGES.items():
        sources[path] = (ROOT / path).read_text(encoding="utf-8")
        files.append(File.generated(config, target, content=rewritten(path, sources[path])))
    for path in sorted(set().union(*(copied(page, text) for page, text in sources.items()))):
        content = (ROOT / path).read_bytes()
        files.append(File.generated(config, f"{COPIES}/{path}", content=content))
    for name, path in labs().items():
        files.append(File.generated(config, f"labs/{name}.html", content=path.read_bytes()))
    workspace = ROOT / "ros2_ws" / "src"
    for page, text in sources.items():
        for path in sorted({path.rstrip("./") for path in _PATH.findall(text)}):
            folders = (ROOT, workspace, workspace / path.partition("/")[0])
            if not any((folder / path).exists() for folder in folders):
                _log.warning("%s names `%s`, which does not exist", page, path)
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Rewrite a page's links and mathematics; the pages from outside docs/ have their links already."""
    if not page.file.generated_by:
        markdown = rewritten(f"docs/{page.file.src_uri}", markdown)
    return typeset(_MADE.sub(lambda match: made(match[1]), markdown))
