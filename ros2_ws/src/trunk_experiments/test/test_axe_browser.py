"""Live page and report are accessible by the rules of axe, light and dark, on a desk and on a phone."""

from __future__ import annotations

import pytest

from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.views.report import make_report, write
from trunk_experiments.views.run_view import RunView

from .graph_double import ServedGraph

pytestmark = pytest.mark.browser

LOOKS = [
    ({"width": 1400, "height": 900}, "light"),
    ({"width": 1400, "height": 900}, "dark"),
    ({"width": 390, "height": 844}, "light"),
]


@pytest.fixture(scope="module")
def addresses(short_run, tmp_path_factory):
    """Yield the addresses of a live page and of a report."""
    served = ServedGraph()
    path = tmp_path_factory.mktemp("axe") / "report.html"
    write(make_report([RunView.read(RecordedRun.open(short_run("fig8", "fuzzy_pid")))]), path)
    yield {"live": served.address, "report": path.as_uri()}
    served.close()


@pytest.mark.parametrize("name", ["live", "report"])
@pytest.mark.parametrize(("viewport", "scheme"), LOOKS, ids=["desk", "dark", "phone"])
def test_axe_has_no_complaint(browser, addresses, name, viewport, scheme):
    pytest.importorskip(
        "axe_playwright_python", reason="axe-playwright-python: scripts/bootstrap.sh"
    )
    from axe_playwright_python.sync_playwright import Axe

    with browser.new_context(viewport=viewport, color_scheme=scheme, bypass_csp=True) as context:
        context.set_default_timeout(0)  # pytest has one
        page = context.new_page()
        page.goto(addresses[name])
        page.wait_for_selector("html[data-ready]")
        found = Axe().run(page).response
        assert [rule["id"] for rule in found["violations"]] == []
        assert len(found["passes"]) > 15
