"""The lab's page as a user sees it: push, change, branch, compare, take it away; in Chromium."""

from __future__ import annotations

import json
import shlex

import pytest
from click.testing import CliRunner

from trunk_experiments.commands.exchange.export_web import command
from trunk_experiments.lab.wasm import missing_tools

pytestmark = [
    pytest.mark.skipif(bool(missing_tools()), reason=missing_tools()),
    pytest.mark.browser,
]

DESK, PHONE = {"width": 1400, "height": 900}, {"width": 390, "height": 844}
SETUP = "() => JSON.stringify(wire.setup)"
# All bits of the runs' tables, up to a state, as a number each.
TABLES = """(states) => wire.engines.map(({ table, count, width }) => {
  const words = new Uint32Array(table.buffer, 0, 2 * width * Math.min(count, states ?? count));
  return words.reduce((sum, word) => Math.imul(sum ^ word, 16777619) >>> 0, 2166136261); })"""
THETA = "(engine) => Array.from(engine.column('theta'))"
P_MAX = "#gain-fuzzy_pid-gains-p_max"
# A click on a cell of Kp: the row and column of zero.
CELL = "#tables .rule-table:first-child tbody tr:nth-child(4) td:nth-child(5) button"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("lab") / "lab.html"
    words = ["fig8", "--duration", "3", "-o", str(path)]
    done = CliRunner().invoke(command, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture(scope="module")
def data(path):
    """Return the lab's data as the page has them, and their size."""
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

    def go(viewport=DESK, fragment="", **more):
        context = browser.new_context(viewport=viewport, accept_downloads=True, **more)
        contexts.append(context)
        context.set_default_timeout(0)  # pytest has one
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri() + fragment)
        whole(page)
        return page

    yield go
    for context in contexts:
        context.close()
    assert complaints == []
    assert all(url.startswith(("file:", "data:", "blob:")) for url in requests), requests


def whole(page):
    page.wait_for_selector("html[data-ready][data-whole]")


def setup(page):
    return json.loads(page.evaluate(SETUP))


def set_gain(page, value):
    page.fill(P_MAX, str(value))
    page.press(P_MAX, "Enter")


def seek(page, time):
    page.locator("#seek").fill(str(time))
    page.wait_for_function("(time) => Math.abs(view.time - time) < 1e-9 && !view.playing", arg=time)


def pulled(page, pane=1):
    """Take the tip of a run's trunk in the hand and pull it to the right."""
    x, y = page.evaluate(
        """(pane) => {
          const box = scene.canvas.getBoundingClientRect();
          const { tip } = scene.panes[pane].places;
          return [box.left + tip[0], box.top + tip[1]]; }""",
        pane,
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 10, steps=4)


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
    assert page.inner_text("[data-value=push]").endswith("N·m")
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
    page.wait_for_selector("#gains .refused:not(:empty)")
    assert "gains.p_min must be at most gains.p_max" in page.inner_text("#alarm")
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
    page.fill("#knobs .find", refused[0][1])
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


def test_the_time_is_sought_by_bar_keys_and_chart(opened):
    page = opened()
    seek(page, 1.5)
    page.wait_for_function("() => document.getElementById('time').textContent === '1.50 s'")
    for key, time in (
        ("ArrowRight", 1.51),
        ("Shift+ArrowLeft", 1.41),
        (".", 1.411),
        ("End", 3.0),
        ("Home", 0.0),
    ):
        page.keyboard.press(key)
        assert page.evaluate("() => view.time") == pytest.approx(time, abs=1e-9), key
    box = page.locator("#strip-angle .u-over").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert page.evaluate("() => view.time") == pytest.approx(1.5, abs=0.02)
    page.keyboard.press(" ")
    page.wait_for_function("() => view.time > 1.8 && view.playing")


def test_a_page_that_slept_does_not_jump(opened):
    page = opened()
    seek(page, 0.0)
    page.click("#play")
    page.wait_for_function("() => view.time > 0")
    jump = page.evaluate(
        """() => new Promise((done) => {
          const before = view.time;
          const until = performance.now() + 800;
          while (performance.now() < until);
          requestAnimationFrame(() => requestAnimationFrame(() => done(view.time - before)));
        })"""
    )
    assert jump < 0.4


def test_keys_push_too(opened):
    page = opened()
    seek(page, 0.2)
    page.focus("#scene")
    page.keyboard.down("ArrowRight")
    page.wait_for_function("() => wire.setup.pushes.length > 0 && view.time > 0.3")
    page.keyboard.up("ArrowRight")
    whole(page)
    assert {torque for _, _, torque in setup(page)["pushes"]} == {12, 0}


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
    "[1,{},null,[]]",
    [2, {}, None, []],
    [1, {"nobody": {"x": 1}}, None, []],
    [1, {"pid": {"gains.p": 1e12}}, None, []],
    [1, {"pid": {"gains.p": "<img src=x onerror=alert(1)>"}}, None, []],
    [1, {"pid": {"__proto__": 1}}, None, []],
    [1, {"fuzzy_pid": {"rules.kp": ["B"]}}, None, []],
    [1, {}, [5000, {}], []],
    [1, {}, [100, {"simulator": {"sensor.seed": 5}}], []],
    [1, {}, None, [[100, 0, 1e9]]],
    [1, {}, None, [[100, 0, 1], [-50, 0, 1]]],
    [1, {}, None, [[0.5, 0, 1]]],
    [1, {}, None, "abc"],
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


def test_commands_are_those_of_the_experiment(opened, lab):
    page = opened()
    plain = copied(page)
    assert plain == [
        [*lab["commands"][name], "-o", f"fig8_{name}.mcap"] for name in ("pid", "fuzzy_pid")
    ]
    page.focus("#copied")
    page.keyboard.press("Escape")
    assert page.locator("#copying").is_hidden()
    assert page.evaluate("() => document.activeElement.id") == "copy-commands"
    page.evaluate(
        "() => edits.set('simulator', { 'plant.trunk_mass': 0.625, 'initial.position': [0, 0.3] })"
    )
    page.click(CELL)
    page.wait_for_selector("#tables td[data-edited]")
    whole(page)
    (pid, fuzzy) = copied(page)
    before = len(lab["commands"]["fuzzy_pid"])
    settings = [word for word in fuzzy[before:] if "=" in word]
    label = page.inner_text(CELL)
    assert settings[-1] == f"fuzzy_pid.rules.kp.ZO.ZO={label}"
    assert settings[:-1] == [
        "simulator.plant.trunk_mass=0.625",
        "simulator.initial.position=[0, 0.3]",
    ]
    assert [word for word in pid[len(lab["commands"]["pid"]) :] if "=" in word] == settings[:-1]
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    set_gain(page, 80)
    page.wait_for_function("() => wire.setup.branch.values.fuzzy_pid")
    (_, _, branch) = copied(page)
    assert branch == shlex.split(
        "trunk branch fig8_fuzzy_pid.mcap --at 1.2 --set fuzzy_pid.gains.p_max=80 "
        "-o fig8_fuzzy_pid_branch.mcap"
    )


def test_numbers_of_all_controllers_stand_side_by_side_with_falls_first(opened, lab):
    page = opened()
    assert page.locator("#doubts li.bad").all_inner_texts() == [
        "pid FELL: at t = 1.064 s, −90 degrees",
        "fuzzy_pid FELL: at t = 1.085 s, −90 degrees",
    ]
    page.click("#tab-numbers")
    rows = page.locator("#numbers tr").evaluate_all(
        "rows => rows.map(({ cells }) => [...cells].map((cell) => cell.textContent))"
    )
    assert rows[0] == ["quantity", "pid", "fuzzy_pid"]
    assert rows[1] == ["FELL", "at 1.064 s", "at 1.085 s"]
    assert [row[0] for row in rows[2:]] == [
        f"{label}, {unit}" for label, unit in lab["quantities"].values()
    ]
    assert all(len(row) == 3 for row in rows)
    # Rules and gains are those of the controller that is shown; the other's curve stays.
    assert page.locator("#rules").is_visible()
    page.click("#controllers input[value=pid]")
    page.wait_for_selector("#rules", state="hidden")
    page.click("#tab-parameters")
    assert page.inner_text("#gains-of") == "Gains of pid"
    page.wait_for_function(
        "() => document.getElementById('strip-angle').textContent.includes('fuzzy_pid')"
    )
    assert page.inner_text("#save-recording") == "Save recording of pid"


def test_a_run_that_diverges_says_so(opened):
    page = opened()
    for node, name, value in (("pid", "gains.d", 1000), ("simulator", "plant.length", 1e-6)):
        page.evaluate(f"() => edits.set('{node}', {{ '{name}': {value} }})")
        page.wait_for_function("() => wire.engines[0].ended === 'diverged'")
        whole(page)
        assert page.inner_text("#doubts").startswith("pid DIVERGED: at t = "), name
        for tab in ("#tab-numbers", "#tab-parameters"):
            page.click(tab)
            assert "NaN" not in page.inner_text("body")
        seek(page, 2.0)
    page.evaluate("() => edits.undo()")
    page.wait_for_function("() => !wire.setup.values.simulator")
    page.evaluate("() => edits.undo()")
    page.wait_for_function("() => isDefaultSetup(wire.setup)")
    whole(page)
    assert "DIVERGED" not in page.inner_text("#doubts")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_desk_all_is_on_one_screen(opened, scheme):
    page = opened(color_scheme=scheme)
    page.click("#branch")
    page.wait_for_selector(".chip")
    whole(page)
    assert page.evaluate("() => document.documentElement.scrollHeight <= innerHeight")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert page.locator("#live-charts .chart").count() == 5


def test_on_a_phone_nothing_is_wider_than_the_screen(opened):
    page = opened(PHONE, has_touch=True)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    box = page.locator("#scene").bounding_box()
    assert box["y"] < 500, "the trunks are in sight"
    page.click("#tab-numbers")
    page.click("#copy-commands")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


def test_reduced_motion_waits_for_a_hand(opened):
    page = opened(reduced_motion="reduce")
    assert page.evaluate("() => [view.playing, view.time]") == [False, 0]
    page.click("#play")
    page.wait_for_function("() => view.time > 0.1")


LOOKS = [(DESK, "light"), (DESK, "dark"), (PHONE, "light"), (PHONE, "dark")]


@pytest.mark.parametrize(("viewport", "scheme"), LOOKS, ids=["desk", "dark", "phone", "phone-dark"])
def test_axe_has_no_complaint(browser, path, viewport, scheme):
    pytest.importorskip(
        "axe_playwright_python", reason="axe-playwright-python: scripts/bootstrap.sh"
    )
    from axe_playwright_python.sync_playwright import Axe

    with browser.new_context(viewport=viewport, color_scheme=scheme, bypass_csp=True) as context:
        context.set_default_timeout(0)
        page = context.new_page()
        page.goto(path.as_uri())
        whole(page)
        page.evaluate(
            "() => { document.documentElement.dataset.whole = 'true'; view.freeze(true); }"
        )
        for prepare in ("#branch", "#tab-numbers", "#copy-commands"):
            page.click(prepare)
            whole(page)
            found = Axe().run(page).response
            assert [rule["id"] for rule in found["violations"]] == [], prepare
            assert len(found["passes"]) > 15


def saved(page, name, folder):
    page.click(f"#controllers input[value={name}]")
    page.wait_for_selector(f"#save-recording:enabled >> text=Save recording of {name}")
    with page.expect_download() as download:
        page.click("#save-recording")
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def run(trunk, words):
    """Run words that begin with "trunk"; return what it prints."""
    assert words[0] == "trunk"
    code, out, err = trunk(*words[1:])
    assert code == 0, (words, out, err)
    return out


def copied(page):
    page.click("#copy-commands")
    page.wait_for_selector("#copying:visible")
    lines = page.inner_text("#copied").splitlines()
    return [shlex.split(line) for line in lines if not line.startswith("#")]


def test_saved_runs_are_verified_and_those_of_the_commands(opened, trunk, tmp_path, monkeypatch):
    page = opened()
    set_gain(page, 75)
    page.click(CELL)
    page.wait_for_selector("#tables td[data-edited]")
    page.evaluate("() => edits.set('simulator', { 'plant.trunk_mass': 0.625 })")
    whole(page)
    (tmp_path / "page").mkdir()
    monkeypatch.chdir(tmp_path)
    commands = copied(page)
    for name, words in zip(("pid", "fuzzy_pid"), commands, strict=True):
        mine = saved(page, name, tmp_path / "page")
        assert "verified" in run(trunk, ["trunk", "verify", mine])
        run(trunk, words)
        assert "identical" in run(trunk, ["trunk", "diff", mine, tmp_path / mine.name])
    # A branch, from the command's run.
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    set_gain(page, 80)
    page.wait_for_function("() => wire.setup.branch.values.fuzzy_pid")
    whole(page)
    branch = copied(page)[-1]
    mine = saved(page, "fuzzy_pid", tmp_path / "page")
    assert "verified" in run(trunk, ["trunk", "verify", mine])
    run(trunk, branch)
    assert "identical" in run(trunk, ["trunk", "diff", mine, tmp_path / branch[-1]])


def test_a_run_pushed_by_hand_is_saved_with_the_pushes(opened, trunk, tmp_path, monkeypatch):
    page = opened()
    seek(page, 0.2)
    pulled(page)
    page.wait_for_function("() => wire.setup.pushes.length > 2 && view.time > 0.4")
    page.mouse.up()
    whole(page)
    monkeypatch.chdir(tmp_path)
    again = copied(page)[-1]
    mine = saved(page, "fuzzy_pid", tmp_path)
    assert "verified" in run(trunk, ["trunk", "verify", mine])
    assert "operator/push" in run(trunk, ["trunk", "info", mine])
    run(trunk, again)
    assert "identical" in run(trunk, ["trunk", "diff", mine, again[-1]])


def test_scripts_styles_and_html_are_small(path, data):
    assert path.stat().st_size - len(data) < 250_000
    assert path.stat().st_size < 400_000
