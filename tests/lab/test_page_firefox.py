"""The lab's page in Firefox: push by mouse, knob, rule cell, branch, link, nonsense, save."""

import json

import pytest

from .firefox import PROGRAM, Firefox

pytestmark = [
    pytest.mark.skipif(PROGRAM is None, reason="Firefox: apt-get install firefox-esr"),
    pytest.mark.browser,
    pytest.mark.slow,
]
WHOLE = "document.documentElement.dataset.whole === 'true'"
TIP = """(() => {
  const box = scene.canvas.getBoundingClientRect();
  const { tip } = scene.panes[0].places;
  return [box.left + tip[0], box.top + tip[1]].map(Math.round); })()"""
BITS = """wire.engines.map(({ table, count, width }) => new Uint32Array(table.buffer, 0, 2 * width * count)
  .reduce((sum, word) => Math.imul(sum ^ word, 16777619) >>> 0, 2166136261))"""


@pytest.fixture
def firefox(path, tmp_path):
    with Firefox(tmp_path) as browser:
        browser.open(path.as_uri())
        browser.evaluate("(globalThis.wrong = [], onerror = (text) => { wrong.push(text); }, 0)")
        yield browser
        assert browser.evaluate("wrong") == []


def until(browser, condition):
    """Wait in the page, picture by picture."""
    look = f"() => (({condition}) ? done(true) : requestAnimationFrame(look))"
    browser.evaluate(f"new Promise((done) => {{ const look = {look}; look(); }})")


def click(browser, selector):
    browser.evaluate(f"(document.querySelector({json.dumps(selector)}).click(), 0)")


def test_the_page_works(firefox, path):
    until(firefox, WHOLE)
    assert firefox.evaluate("document.querySelectorAll('#doubts li.bad').length") == 2
    before = firefox.evaluate(BITS)
    # A knob, a rule cell, and back.
    firefox.evaluate("edits.set('fuzzy_pid', { 'gains.p_max': 75 }).then(() => 0)")
    click(firefox, "#tables td button")
    until(firefox, f"Object.keys(wire.setup.values.fuzzy_pid ?? {{}}).length === 2 && {WHOLE}")
    changed = firefox.evaluate(BITS)
    assert (changed[0] == before[0], changed[1] == before[1]) == (True, False)
    click(firefox, "#undo")
    until(firefox, "Object.keys(wire.setup.values.fuzzy_pid).length === 1")
    click(firefox, "#reset-all")
    until(firefox, f"isDefaultSetup(wire.setup) && {WHOLE}")
    assert firefox.evaluate(BITS) == before
    # A hand on the trunk.
    firefox.evaluate("(view.seek(0.2), 0)")
    until(firefox, "scene.panes[0]?.places")
    x, y = firefox.evaluate(TIP)
    firefox.point([("move", x, y), ("down",), ("move", x + 60, y + 10)])
    until(firefox, "wire.setup.pushes.length > 2 && view.time > 0.4")
    firefox.point([("up",)])
    until(firefox, f"wire.setup.pushes.at(-1)[2] === 0 && {WHOLE}")
    # What if from here, and all of it as a link.
    firefox.evaluate("(view.seek(1.2), 0)")
    click(firefox, "#branch")
    until(firefox, f"wire.setup.branch && {WHOLE}")
    firefox.evaluate("edits.set('pid', { 'gains.p': 33.125 }).then(() => 0)")
    until(firefox, WHOLE)
    setup, bits = firefox.evaluate("wire.setup"), firefox.evaluate(BITS)
    assert setup["branch"] == {"at_ns": 1_200_000_000, "values": {"pid": {"gains.p": 33.125}}}
    click(firefox, "#copy-link")
    until(firefox, "location.hash.length > 1")
    address = firefox.evaluate("location.href")
    firefox.open("about:blank")
    firefox.open(address)
    until(firefox, f"wire.setup.branch && {WHOLE}")
    assert firefox.evaluate("wire.setup") == setup
    assert firefox.evaluate(BITS) == bits
    digest = firefox.evaluate(
        "setups.experiment(lab, 'pid', wire.engines[0]).then((e) => e.sha256)"
    )
    assert len(digest) == 64
    firefox.evaluate("(globalThis.wrong = [], location.hash = 'nonsense', 0)")
    until(firefox, f"!document.getElementById('alarm').hidden && {WHOLE}")
    words = firefox.evaluate("document.getElementById('alarm-text').textContent")
    assert words == "the link: it is damaged; this is the default experiment"
    assert firefox.evaluate(BITS) == before
