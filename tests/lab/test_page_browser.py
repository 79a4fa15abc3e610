"""The lab's page as a user sees it: push, change, branch, scrub, link; in Chromium."""

import json

import pytest

from trunk_experiments.lab.experiment import FORMAT

from .page_actions import (
    CELL,
    P_MAX,
    TABLES,
    THETA,
    pulled,
    seek,
    set_gain,
    setup,
    whole,
)

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("pane", [0, 1])
def test_a_hand_on_one_trunk_pushes_all(opened, lab, pane):
    page = opened()
    seek(page, 0.2)
    pulled(page, pane)
    page.wait_for_function("() => wire.setup.pushes.length > 2 && view.time > 0.4")
    # While it pulls, nothing is computed ahead of what is shown.
    assert page.evaluate(
        "() => wire.engines.every((e) => e.count <= Math.round(view.time * 1000) + 2)"
    )
    page.wait_for_function(
        "() => document.querySelector('[data-value=push]').innerText.endsWith('N·m')"
    )
    page.mouse.up()
    whole(page)
    pushes = setup(page)["pushes"]
    assert pushes[-1][1:] == [0, 0]
    assert max(abs(torque) for _, _, torque in pushes) > 1
    assert all(stamp >= 200_000_000 and stamp % lab["period_ns"] == 0 for stamp, _, _ in pushes)
    assert page.evaluate("() => wire.engines.map((engine) => engine.setup.pushes)") == [pushes] * 2
    assert page.locator(".chip").all_inner_texts() == ["1 push by hand ✕"]
    # What came of it is what the same experiment gives at once.
    tables = page.evaluate(TABLES)
    page.evaluate("(text) => wire.take(JSON.parse(text)).then(wire.whole)", json.dumps(setup(page)))
    whole(page)
    assert page.evaluate(TABLES) == tables
    page.click(".chip")
    whole(page)
    assert setup(page)["pushes"] == []
    assert page.locator(".chip").count() == 0


def test_a_knob_and_a_rule_are_changed_and_taken_back(opened):
    page = opened()
    before = page.evaluate(TABLES)
    set_gain(page, 75)
    page.wait_for_function("() => wire.setup.values.fuzzy_pid?.['gains.p_max'] === 75")
    page.click(CELL)
    page.wait_for_selector("#tables td[data-edited]")
    whole(page)
    values = setup(page)["values"]
    assert list(values) == ["fuzzy_pid"]
    assert set(values["fuzzy_pid"]) == {"gains.p_max", "rules.kp"}
    after = page.evaluate(TABLES)
    assert after[0] == before[0], "pid has no such gain"
    assert after[1] != before[1]
    for _ in range(2):
        page.wait_for_selector("#undo:enabled")
        page.keyboard.press("Control+z")
    page.wait_for_function("() => isDefaultSetup(wire.setup)")
    whole(page)
    assert page.evaluate(TABLES) == before
    assert page.locator("#reset-all").is_disabled()


def test_what_is_refused_says_why_and_changes_nothing(opened, lab):
    page = opened()
    set_gain(page, 1)  # below p_min
    refused = page.wait_for_selector("#gains .refused:not(:empty)").inner_text()
    assert "gains.p_min must be at most gains.p_max" in refused
    assert setup(page)["values"] == {}
    page.wait_for_function("(at) => document.querySelector(at).value === '60'", arg=P_MAX)
    # At its bound a knob still works.
    page.evaluate("() => edits.set('simulator', { max_effort: 0.5 })")
    whole(page)
    assert "at its torque limit" in page.inner_text("#doubts")
    page.click("#reset-all")
    whole(page)
    assert setup(page) == {"values": {}, "branch": None, "pushes": []}
    refused = [
        (node, name)
        for node, names in lab["declared"].items()
        for name, about in names.items()
        if about["refused"]
    ]
    assert refused
    page.fill("#parameters .find", refused[0][1])
    knob = page.locator("#knobs .knob[data-refused]:visible").first
    assert "fixed in this lab: " in knob.inner_text()
    assert knob.locator("input, select").first.is_disabled()


def test_what_if_from_here(opened):
    page = opened()
    original, begun = page.evaluate(TABLES), page.evaluate(TABLES, 1200)
    theta = page.evaluate(f"() => ({THETA})(wire.engines[1])")
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    whole(page)
    assert page.inner_text(".chip") == "branch at t = 1.2 s ✕"
    set_gain(page, 80)
    page.wait_for_function("() => wire.setup.branch.values.fuzzy_pid")
    whole(page)
    assert setup(page)["branch"] == {
        "at_ns": 1_200_000_000,
        "values": {"fuzzy_pid": {"gains.p_max": 80}},
    }
    assert setup(page)["values"] == {}
    assert page.evaluate(TABLES, 1200) == begun
    assert page.evaluate(TABLES)[0] == original[0]
    assert page.evaluate(TABLES)[1] != original[1]
    # The original stays in sight, in the chart and its legend.
    assert "before the branch" in page.inner_text("#strip-angle figcaption")
    kept = page.evaluate(
        "() => Array.from(known.runs[1].before.plant.columns.get('theta').subarray(0, 3001))"
    )
    assert kept == theta
    # What changes only a whole run cannot be changed in a branch.
    seed = page.locator("#knob-simulator-sensor-seed")
    assert seed.is_disabled()
    page.click(".chip")
    page.wait_for_function("() => !wire.setup.branch")
    assert page.locator("#undo").is_disabled(), "the branch's changes went with it"
    whole(page)
    assert page.evaluate(TABLES) == original
    assert seed.is_enabled()
    assert "before the branch" not in page.inner_text("#strip-angle figcaption")


def test_a_page_that_slept_does_not_jump(opened):
    page = opened()
    seek(page, 0.0)
    page.click("#play")
    page.wait_for_function("() => view.time > 0")
    # Eight tenths of a second are the fault itself; then the second picture from there on is drawn.
    pictures, jump = page.evaluate(
        """() => new Promise((done) => {
          const until = performance.now() + 800;
          while (performance.now() < until);
          const [time, frames] = [view.time, view.frames];
          const look = () => (view.frames < frames + 2 ? requestAnimationFrame(look)
            : done([view.frames - frames, view.time - time]));
          requestAnimationFrame(look);
        })"""
    )
    assert jump < 0.1 * pictures + 0.001  # each goes on by a tenth of a second at most


def test_a_link_has_the_whole_experiment(opened):
    page = opened()
    set_gain(page, 75)
    page.click(CELL)
    whole(page)
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    page.evaluate("() => edits.set('simulator', { 'sensor.seed': 7 })")
    page.evaluate("() => edits.set('pid', { 'gains.p': 33.125 })")
    whole(page)
    page.focus("#scene")
    page.keyboard.down("ArrowLeft")
    page.wait_for_function("() => wire.setup.pushes.length > 0 && view.time > 1.4")
    page.keyboard.up("ArrowLeft")
    whole(page)
    page.click("#copy-link")
    page.wait_for_selector("#copying:visible")
    link = page.inner_text("#copied")
    assert link == page.evaluate("() => location.href")
    assert len(link) < 1000
    again = opened(fragment="#" + link.partition("#")[2])
    again.wait_for_selector(".chip >> nth=1")
    whole(again)
    assert setup(again) == setup(page)
    assert again.evaluate(TABLES) == page.evaluate(TABLES)
    assert again.input_value(P_MAX) == "75"


NONSENSE = [
    "nonsense",
    "%00%ff",
    "A" * 200_000,
    "{}",
    [],
    {"format": "trunk experiment 1"},
    *(
        {"format": FORMAT, "values": {}, "branch": None, "pushes": [], **wrong}
        for wrong in (
            {"values": {"nobody": {"x": 1}}},
            {"values": {"pid": {"gains.p": 1e12}}},
            {"values": {"pid": {"gains.p": "<img src=x onerror=alert(1)>"}}},
            {"values": {"pid": {"__proto__": 1}}},
            {"values": {"__proto__": {"toString": 1}}},
            {"values": {"fuzzy_pid": {"rules.kp": ["B"]}}},
            {"values": {"pid": None}},
            {"values": []},
            {"branch": 7},
            {"branch": {"at_ns": 0}},
            {"branch": {"at_ns": 5_000_000_000, "values": {}}},
            {"branch": {"at_ns": "0", "values": {}}},
            {"branch": {"at_ns": 0, "values": {"simulator": {"sensor.seed": 5}}}},
            {"pushes": [[100_000_000, 0, 1e9]]},
            {"pushes": [[100_000_000, 0, 1], [50_000_000, 0, 1]]},
            {"pushes": [[0.5, 0, 1]]},
            {"pushes": [[0, 0, 1, 1]]},
            {"pushes": "abc"},
        )
    ),
]


def test_a_link_with_nonsense_is_one_line_and_the_default_experiment(opened):
    page = opened()
    pack = """async (text) => {
      const blob = new Blob([text]);
      const packed = new Response(blob.stream().pipeThrough(new CompressionStream("deflate-raw")));
      const letters = btoa(String.fromCharCode(...new Uint8Array(await packed.arrayBuffer())));
      return letters.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", ""); }"""
    for data in NONSENSE:
        fragment = data if isinstance(data, str) else page.evaluate(pack, json.dumps(data))
        page.evaluate("() => document.getElementById('alarm-close').click()")
        page.evaluate("(fragment) => { location.hash = fragment; }", fragment)
        page.wait_for_selector("#alarm:visible")
        whole(page)
        words = page.inner_text("#alarm-text")
        assert words.startswith("the link: "), data
        assert words.endswith("; this is the default experiment"), data
        assert "\n" not in words, data
        assert setup(page) == {"values": {}, "branch": None, "pushes": []}, data
        assert page.evaluate("() => document.images.length") == 0
    page.evaluate("() => { location.hash = ''; }")
    page.wait_for_selector("#alarm", state="hidden")
