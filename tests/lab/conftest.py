"""A lab's page, made by the verb and opened in Chromium."""

import json
import shutil

import pytest
from ros2_ws.src.trunk_views.test.page_driver import DESK
from ros2_ws.src.trunk_views.test.page_driver import opened as opened_page  # noqa: F401

from trunk_experiments.lab.webassembly import missing_tools

from .experiments import page_of
from .page_actions import WHOLE


@pytest.fixture(scope="session")
def path(tmp_path_factory):
    """Return a lab of fig8, 3 s long, with both of the paper's controllers."""
    if reason := missing_tools():
        pytest.skip(reason)
    path = tmp_path_factory.mktemp("lab") / "lab.html"
    path.write_bytes(page_of("fig8", "--duration", "3"))
    return path


@pytest.fixture(scope="session")
def data(path):
    """Return the lab's data as the page has them."""
    text = path.read_text(encoding="utf-8")
    begin = text.index('id="lab-data">') + len('id="lab-data">')
    return text[begin : text.index("</script>", begin)]


@pytest.fixture(scope="session")
def lab(data):
    return json.loads(data)


@pytest.fixture
def opened(opened_page, path):  # noqa: F811
    """Return a function that opens the page, and waits until its run is computed."""

    def go(viewport=DESK, fragment="", **more):
        return opened_page(path.as_uri() + fragment, viewport, WHOLE, **more)

    return go


@pytest.fixture
def tools():
    """Skip where a lab's loops cannot be compiled, or its scripts not run without a browser."""
    if missing := missing_tools() or (
        "" if shutil.which("node") else "no node: apt-get install nodejs"
    ):
        pytest.skip(missing)
