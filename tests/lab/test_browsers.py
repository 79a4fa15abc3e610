"""The lab's page computes the same bits in Chromium and in Firefox as its engines in Node."""

import pytest

from trunk_experiments.lab.data import write
from trunk_experiments.lab.webassembly import missing_tools

from .experiments import LAWS, NODE, in_node, in_page, lab_for, plans_of, random_setup
from .firefox import PROGRAM, Firefox

pytestmark = [
    pytest.mark.skipif(bool(missing_tools()), reason=missing_tools()),
    pytest.mark.skipif(NODE is None, reason="Node.js: the lab's runs outside of a browser"),
    pytest.mark.slow,
    pytest.mark.browser,
]
COUNT = 12


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    lab = lab_for(plans_of("fig8"))
    path = tmp_path_factory.mktemp("lab") / "lab.html"
    write(lab, path)
    experiments = [(LAWS[i % 4], random_setup(lab, LAWS[i % 4], i)) for i in range(COUNT)]
    expected = [result.get("bits") or result["error"] for result in in_node(lab, experiments)]
    return path, experiments, expected


@pytest.mark.one_in(4)
def test_chromium_computes_the_same_bits(page, opened_page):
    path, experiments, expected = page
    tab = opened_page(path, bypass_csp=True)
    assert in_page(tab.evaluate, experiments) == expected


@pytest.mark.skipif(PROGRAM is None, reason="Firefox: apt-get install firefox-esr")
def test_firefox_computes_the_same_bits(page, tmp_path):
    path, experiments, expected = page
    with Firefox(tmp_path) as firefox:
        firefox.open(path.as_uri())
        assert in_page(firefox.evaluate, experiments) == expected
