"""A lab's page, made by the verb and opened in Chromium."""

from __future__ import annotations

import json
import shutil

import pytest
from click.testing import CliRunner

from trunk_experiments.commands.lab import command
from trunk_experiments.lab.wasm import missing_tools


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return a lab of fig8, 3 s long, with both of the paper's controllers."""
    if reason := missing_tools():
        pytest.skip(reason)
    path = tmp_path_factory.mktemp("lab") / "lab.html"
    words = ["fig8", "--duration", "3", "-o", str(path)]
    done = CliRunner().invoke(command, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture(scope="module")
def data(path):
    """Return the lab's data as the page has them."""
    text = path.read_text(encoding="utf-8")
    begin = text.index('id="lab-data">') + len('id="lab-data">')
    return text[begin : text.index("</script>", begin)]


@pytest.fixture(scope="module")
def lab(data):
    return json.loads(data)


@pytest.fixture
def opened(browser, path):
    """Return a function that opens the page; it asks no host for anything, and nothing may go wrong in it."""
    contexts, complaints, requests = [], [], []

    def go(viewport=None, fragment="", **more):
        viewport = viewport or {"width": 1400, "height": 900}
        context = browser.new_context(viewport=viewport, accept_downloads=True, **more)
        contexts.append(context)
        context.set_default_timeout(0)  # pytest has one
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri() + fragment)
        page.wait_for_selector("html[data-ready][data-whole]")
        return page

    yield go
    for context in contexts:
        context.close()
    assert complaints == []
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests), requests


@pytest.fixture
def tools():
    """Skip where a lab's loops cannot be compiled, or its scripts not run without a browser."""
    if missing := missing_tools() or (
        "" if shutil.which("node") else "no node: apt-get install nodejs"
    ):
        pytest.skip(missing)
