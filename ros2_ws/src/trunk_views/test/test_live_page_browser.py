"""The live page as a dashboard: what is on the screen, what keeps its place, what can be taken back."""

import pytest

from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_core.parameters.declarations import values_of
from trunk_core.parameters.parameter_files import read
from trunk_views.live.server import PageFile

from .graph_double import ServedGraph
from .page_driver import DESK, FITS, NARROW, PHONE, across, until

pytestmark = pytest.mark.browser

PANELS = ("#scene", "#readout", ".find", ".rule-table", "#live-charts .chart", ".bar button")
# What of these elements is not wholly in sight: outside the window, cut off by a panel, behind something.
HIDDEN = """(selector) => [...document.querySelectorAll(selector)]
  .filter((element) => element.checkVisibility())
  .filter((element) => {
    const { left, right, top, bottom } = element.getBoundingClientRect();
    return ![[left + 5, top + 5], [right - 5, bottom - 5], [(left + right) / 2, (top + bottom) / 2]]
      .every(([x, y]) => element.contains(document.elementFromPoint(x, y))
        || document.elementFromPoint(x, y)?.matches(".rule-dot"));
  }).map((element) => element.id || element.textContent)"""
# Words that are broken over two lines.
BROKEN = """(selector) => [...document.querySelectorAll(selector)].flatMap((cell) => {
  const texts = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
  const broken = [];
  while (texts.nextNode()) {
    for (const { 0: word, index } of texts.currentNode.data.matchAll(/[\\w.]+/g)) {
      const range = document.createRange();
      range.setStart(texts.currentNode, index);
      range.setEnd(texts.currentNode, index + word.length);
      if (new Set([...range.getClientRects()].map(({ top }) => top)).size > 1) broken.push(word);
    }
  }
  return broken;
})"""
CONTROLLERS = "[...document.querySelectorAll('#controllers input')].map((one) => one.value)"
GROUPS = "[...document.querySelectorAll('#knobs details')].map((one) => one.dataset.node)"
ORDER = f"() => [{CONTROLLERS}, {GROUPS}]"
P_MAX = "known.nodes.get('fuzzy_pid').parameters['gains.p_max']"
RULE = "known.nodes.get('fuzzy_pid').parameters['rules.kp'][0]"


@pytest.fixture(scope="module")
def served():
    served = ServedGraph()
    yield served
    served.close()


@pytest.fixture
def opened(opened, served):
    """Return a function that opens the page."""

    def go(viewport=DESK, of=served, **more):
        page = opened(of.address, viewport, **more)
        page.wait_for_function(f"() => {GROUPS}.length === 3 && known.control.count > 50")
        page.wait_for_selector("#gains .knob")
        page.wait_for_selector(".rule-dot")
        return page

    return go


def test_on_a_desk_nothing_is_out_of_sight(opened):
    page = opened()
    for scheme in ("dark", "light"):
        page.emulate_media(color_scheme=scheme)
        for selector in PANELS:
            assert page.locator(selector).count() > 0, selector
            assert page.evaluate(HIDDEN, selector) == [], selector
    assert page.locator("#gains .knob").count() == 4
    assert page.locator("#stop").is_visible()
    assert page.locator("#speed-label").is_visible()
    middles = page.locator(".bar :is(button, select, input, output):visible").evaluate_all(
        "all => all.map((one) => one.getBoundingClientRect()).map((box) => (box.top + box.bottom) / 2)"
    )
    assert max(middles) - min(middles) < 5, "the controls are one row"
    # An alarm takes its place from the charts, not from the screen; more than that makes the page longer.
    page.evaluate("() => alarm.say('the gateway does not answer')")
    assert page.evaluate(FITS)
    assert page.evaluate(HIDDEN, ".rule-table") == []
    page.evaluate("() => alarm.say('and so on')")
    page.click("#branch")
    place = page.locator("#live-charts")
    assert place.evaluate("(place) => place.scrollHeight <= place.clientHeight")
    assert page.locator("#scene").bounding_box()["height"] >= 200


def test_a_separator_stands_between_two_groups(opened):
    page = opened()
    for width in (800, 1000, 1400):
        page.set_viewport_size({"width": width, "height": 900})
        left = page.locator(".bar").bounding_box()["x"]
        groups = [box.bounding_box() for box in page.locator(".bar .group").all()]
        rows = {page.locator("#controllers").bounding_box()["y"]} | {box["y"] for box in groups}
        clipped = [box for box in groups if box["x"] <= left]
        assert len(clipped) == len(rows) - 1, width


def test_standing_still_looks_still(opened):
    page = opened()
    page.evaluate(
        """() => {
          const still = (column) => column.forEach((_, i) => { column[i] = 1e-9 * Math.sin(i); });
          for (const name of ["theta", "torque"]) still(known.plant.column(name));
          for (const name of ["measurement", "p_term", "i_term", "d_term"]) still(known.control.column(name));
          known.version += 1;
        }"""
    )
    for name in ("angle", "torque", "terms"):
        page.wait_for_function(
            """(name) => {
              const { min, max } = strips.made.get(name).plot.scales.y;
              return max - min > 0.09 && max - min < 0.3;
            }""",
            arg=name,
        )


def test_on_a_phone_nothing_covers_the_torque_and_no_word_is_broken(opened, served):
    page = opened(PHONE)
    for scrolled in range(0, 700, 50):  # wherever it is on the screen
        page.evaluate(f"() => scrollTo(0, {scrolled})")
        box = page.locator("[data-value=torque]").bounding_box()
        if 0 <= box["y"] <= PHONE["height"] - box["height"]:
            assert page.evaluate(HIDDEN, "[data-value=torque]") == [], scrolled
        else:
            assert scrolled > 0, "it is in sight at first"
    assert page.evaluate(NARROW)
    said = "document.querySelector('#strip-angle .key').textContent"
    page.evaluate(  # its curves are below the screen
        """() => {
          const { top } = document.querySelector("#strip-angle .strip").getBoundingClientRect();
          scrollBy(0, top - innerHeight);
        }"""
    )
    page.wait_for_function("() => strips.made.get('torque').seen === false")
    before = page.evaluate(said)
    served.call(served.graph.go, served.graph.t + 1.0)
    page.wait_for_function(f"(before) => {said} !== before", arg=before)
    served.call(
        served.graph.graph.diagnosed,
        "fuzzy_pid",
        1,
        "commands limited 1234567890123",
        {"retuned_parameters": "3", "longest_computation_time": "0.00012345"},
    )
    page.wait_for_function("() => known.health.size === 1")
    page.click("#tab-nodes")
    assert page.evaluate(BROKEN, "#nodes :is(td, th)") == []
    page.click("#tab-parameters")
    page.evaluate(
        "() => document.querySelectorAll('#knobs details').forEach((d) => { d.open = true; })"
    )
    names = page.evaluate(BROKEN, ".knob label")
    assert all(name.endswith((".", "_")) or len(name) > 18 for name in names), names
    assert page.evaluate(NARROW)


def test_a_law_without_gains_or_rules_has_its_own_charts_alone(opened):
    page = opened()
    page.evaluate(
        """() => {
          const terms = { error: "rad", swing_energy: "N m", effort: "N m" };
          known.nodes.set("mine", { name: "mine", controller: true, terms, rules: null, parameters: {} });
          known.run.acting = ["mine"];
          rules.show(); }"""
    )
    page.wait_for_selector("#rules", state="hidden")
    page.wait_for_selector("#strip-own-swing_energy")
    title = "({ firstChild }) => firstChild.textContent"
    titles = f"() => [...document.querySelectorAll('#live-charts figcaption')].map({title})"
    assert page.evaluate(titles) == ["Angle, °", "Torque, N·m", "swing energy, N·m"]
    page.evaluate("() => { known.run.acting = ['fuzzy_pid']; rules.show(); }")
    page.wait_for_selector("#rules")
    page.wait_for_selector("#strip-gains")


def test_the_order_of_controllers_and_groups_never_changes(opened, served):
    page = opened()
    order = [["fuzzy_pid", "pid"], ["fuzzy_pid", "pid", "simulator"]]
    assert page.evaluate(ORDER) == order
    page.click("#controllers input[value=pid]")
    until(page, "document.getElementById('gains-of').textContent", "Gains of pid")
    visible = page.locator("#gains .knob:visible label").all_inner_texts()
    assert visible == ["gains.p", "gains.i", "gains.d"]
    assert page.evaluate(ORDER) == order
    page.reload()  # the gateway now tells of pid last
    page.wait_for_selector("#gains .knob")
    page.wait_for_function(f"() => {GROUPS}.length === 3")
    assert page.evaluate(ORDER) == order
    page.click("#controllers input[value=fuzzy_pid]")
    until(page, "document.getElementById('gains-of').textContent", "Gains of fuzzy_pid")


def test_a_page_that_was_cut_off_comes_back(opened, served):
    page = opened()
    for _ in range(2):
        before = page.evaluate("() => known.client")
        served.call(lambda: [one.send_away("cut off", 1001) for one in served.gateway.clients])
        page.wait_for_function("(before) => known.client !== before", arg=before)
    until(page, "document.getElementById('link').textContent", "connected")
    rows = page.evaluate("() => known.control.count")
    served.call(served.graph.go, served.graph.t + 0.1)
    page.wait_for_function("(before) => known.control.count > before", arg=rows)


def test_the_two_pauses_have_names_of_their_own(opened, served):
    page = opened()
    run, view = page.locator("#pause"), page.locator("#play")
    assert (run.inner_text(), view.inner_text()) == ("Pause run", "Freeze view")
    view.click()
    assert (run.inner_text(), view.inner_text()) == ("Pause run", "Back to live")
    view.click()
    served.call(served.graph.event, "simulator", "paused")
    until(page, "document.getElementById('pause').textContent", "Resume run")
    assert view.inner_text() == "Freeze view"
    served.call(served.graph.event, "simulator", "resumed")


def test_a_dragged_slider_keeps_its_scale_and_is_undone_as_one(opened):
    page = opened()
    slider = page.get_by_label("Gain gains.p_max")
    ends = "one => [one.min, one.max, one.step]"
    before = slider.evaluate(ends)
    page.mouse.move(*across(slider))
    page.mouse.down()
    for part in (0.7, 0.8, 0.9):
        page.mouse.move(*across(slider, part))
        page.wait_for_function(f"(value) => {P_MAX} === value", arg=float(slider.input_value()))
    page.mouse.up()
    value = page.evaluate(f"() => {P_MAX}")
    assert value > 90
    assert len(str(value)) <= 5, "sensible digits"
    assert slider.evaluate(ends) == before
    knob = page.locator("#gains .knob[data-set]")
    assert knob.count() == 1
    until(page, "document.getElementById('undo').disabled", False)
    page.click("#undo")
    until(page, P_MAX, 60)
    assert page.locator("#undo").is_disabled()
    assert knob.count() == 0
    assert slider.evaluate(ends) == before


def test_long_values_are_rounded_until_they_are_edited(opened):
    page = opened()
    page.evaluate("() => edits.set('fuzzy_pid', { 'gains.p_max': 61.234567890123 })")
    until(page, P_MAX, 61.234567890123)
    field = page.locator("#gain-fuzzy_pid-gains-p_max")
    page.wait_for_function(
        "() => document.getElementById('gain-fuzzy_pid-gains-p_max').value === '61.2346'"
    )
    field.focus()
    assert field.input_value() == "61.234567890123"
    field.blur()
    assert field.input_value() == "61.2346"
    assert page.evaluate(f"() => {P_MAX}") == 61.234567890123
    page.locator("#gains .knob[data-set] .reset").click()
    until(page, P_MAX, 60)


def test_changes_are_marked_saved_and_taken_back(opened, tmp_path):
    page = opened()
    assert page.locator("#save").is_disabled()
    cell = page.locator("#tables td button").first
    default = page.evaluate(f"() => {RULE}")
    cell.click()
    page.wait_for_selector("#tables td[data-edited]")
    assert page.locator("#tables td[data-edited]").count() == 1
    assert "by default" in cell.get_attribute("aria-label")
    field = page.locator("#gain-fuzzy_pid-gains-d_min")
    field.fill("8.5")
    field.press("Enter")
    until(page, "document.getElementById('save').textContent", "Save as YAML (2)")
    with page.expect_download() as download:
        page.click("#save")
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    (section,) = read(path).sections
    changed = page.evaluate(f"() => {RULE}")
    usual = values_of(FuzzyPidConfig())
    assert section.values == {
        "gains.d_min": 8.5,
        "rules.kp": [changed, *usual["rules.kp"][1:]],
    }
    page.click("#rules-default")
    until(page, RULE, default)
    assert page.locator("#tables td[data-edited]").count() == 0
    gain = "known.nodes.get('fuzzy_pid').parameters['gains.d_min']"
    for expression, value in ((RULE, changed), (gain, 9.6), (RULE, default)):  # the latest first
        until(page, "document.getElementById('undo').disabled", False)
        page.keyboard.press("Control+z")
        until(page, expression, value)
    until(page, "document.getElementById('save').textContent", "Save as YAML")


def test_a_number_in_a_rule_is_written_over(opened, served):
    page = opened()
    default = page.evaluate(f"() => {RULE}")
    numbers = " ".join(["0.25", "0.5", *default.split()[2:]])
    usual = values_of(FuzzyPidConfig())["rules.kp"]
    served.call(served.graph.graph.parameters, "fuzzy_pid", {"rules.kp": [numbers, *usual[1:]]})
    until(page, RULE, numbers)
    first, second, third = (page.locator("#tables td button").nth(i) for i in range(3))
    page.wait_for_function(
        "() => document.querySelector('#tables td button').textContent === '0.25'"
    )
    field = page.locator("#tables td input")
    first.click()
    assert field.input_value() == "0.25"
    field.fill("0.75")
    field.press("Escape")
    assert (field.count(), first.inner_text(), page.evaluate(f"() => {RULE}")) == (
        0,
        "0.25",
        numbers,
    )
    first.click()
    field.fill("0.75")
    field.press("Enter")
    until(page, RULE, numbers.replace("0.25", "0.75"))
    page.wait_for_function("() => document.activeElement.textContent === '0.75'")
    second.click()  # what is written counts when another cell is clicked, and so does that click
    field.fill("S")
    third.click()
    until(page, "document.querySelectorAll('#tables td input').length", 0)
    labels = page.evaluate("() => known.nodes.get('fuzzy_pid').rules.tables[0].labels")
    old = default.split()[2]
    new = labels[(labels.index(old) + 1) % len(labels)]
    until(page, RULE, " ".join(["0.75", "S", new, *default.split()[3:]]))
    first.click()
    field.fill("high")
    field.press("Enter")
    page.wait_for_selector("#alarm:not(:empty)")
    assert "rules.kp" in page.inner_text("#alarm")
    page.wait_for_function(
        "() => document.querySelector('#tables td button').textContent === '0.75'"
    )
    served.call(served.graph.graph.parameters, "fuzzy_pid", {"rules.kp": list(usual)})
    until(page, RULE, default)


def test_what_is_refused_leaves_nothing_to_undo(opened):
    page = opened()
    field = page.locator("#gain-fuzzy_pid-gains-d_min")
    field.fill("99")
    field.press("Enter")
    refused = page.locator("#parameters .refused:not(:empty), #alarm:visible")
    refused.wait_for()
    assert "gains.d_max" in refused.inner_text(), "it is said once"
    assert page.locator("#undo").is_disabled()
    until(page, "document.getElementById('gain-fuzzy_pid-gains-d_min').value", "9.6")
    swap = page.locator("#controllers input")
    for now in ("pid", "fuzzy_pid"):
        swap.and_(page.locator(f"[value={now}]")).click()
        until(page, "known.run.acting.join()", now)
    assert refused.count() == 0
    page.evaluate("() => view.ask('set', { node: 'pid', values: { 'gains.d': -1 } })")
    refused.wait_for()
    field.fill("9")
    field.press("Enter")
    refused.wait_for(state="detached")
    page.click("#undo")
    until(page, "known.nodes.get('fuzzy_pid').parameters['gains.d_min']", 9.6)


def test_the_filter_hides_empty_groups(opened):
    page = opened()
    find = page.locator("#parameters .find")
    find.fill("gains.p_max")
    shown = "#knobs details:visible"
    assert page.locator(shown).evaluate_all("all => all.map((one) => one.dataset.node)") == [
        "fuzzy_pid"
    ]
    assert page.locator(f"{shown} .knob:visible").count() == 1
    find.fill("no such")
    assert page.locator(shown).count() == 0
    assert page.get_by_text("No parameter has such a name.").is_visible()
    find.fill("")
    assert page.locator(shown).count() == 3


def test_what_is_late_is_an_alarm_and_a_torque_at_its_limit_is_not(opened, served):
    page = opened()
    for limited, late in ((1, 0), (2, 0), (3, 1)):
        assert page.locator("#alarm").is_hidden()
        message = f"commands limited {limited}" + f", states late {late}" * bool(late)
        served.call(served.graph.graph.diagnosed, "pid", 1, message, {})
        page.wait_for_function(
            "(message) => known.health.get('pid')?.message === message", arg=message
        )
    assert page.inner_text("#alarm-text") == "pid: states late 1"


def test_a_fall_is_a_mark_in_time_and_every_event_stays_listed(opened, served):
    page = opened()
    listed = "document.querySelectorAll('#events li').length"
    before = page.evaluate(f"() => {listed}")
    graph = served.graph
    served.call(graph.event, "simulator", "fell", angle="-1.0", limit="0.9")
    page.wait_for_function(f"() => {listed} === {before} + 1")
    assert page.locator("#alarm").is_hidden()
    assert "angle −57.3°, limit 51.57°" in page.inner_text("#latest")
    page.click("#tab-happened")
    assert "angle −57.3°, limit 51.57°" in page.inner_text("#events li.fell")
    red = """() => {
      const canvas = document.querySelector("#strip-angle canvas");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      let count = 0;
      for (let i = 0; i < data.length; i += 4)
        count += data[i] === 176 && data[i + 1] === 0 && data[i + 2] === 32;
      return count > 20; }"""
    page.wait_for_function(red)  # the line across the chart
    for number in range(1, 401):  # more than the gateway keeps
        served.call(graph.event, "disturbance", f"event {number}")
        if number % 100 == 0:
            page.wait_for_function(f"() => {listed} === {before + 1 + number}")
    page.wait_for_function("() => document.getElementById('latest').textContent === ''")
    page.reload()
    page.wait_for_function(f"() => {listed} === 300")
    page.click("#tab-happened")
    assert page.inner_text("#earlier") == f"{before + 101} earlier ones are in the recording"


def test_rules_are_hidden_while_their_parameters_are_not_known(opened):
    """A gateway knows the nodes before it knows their parameters."""
    page = opened()
    hidden = "() => { rules.show(); return document.getElementById('rules').hidden; }"
    assert page.evaluate(hidden) is False
    page.evaluate(
        """() => {
          window.whole = known.nodes.get("fuzzy_pid");
          known.nodes.set("fuzzy_pid", { ...window.whole, parameters: {}, rules: null });
        }"""
    )
    assert page.evaluate(hidden) is True
    page.evaluate("() => known.nodes.set('fuzzy_pid', window.whole)")
    assert page.evaluate(hidden) is False


def test_a_report_is_asked_for_once(opened):
    """A second request would break off the first, which may be the last that is answered."""
    served = ServedGraph()
    page = opened(of=served)
    asked = []

    def stay(route):
        asked.append(route.request.url)
        route.fulfill(status=204)

    page.route("**/report-*.html", stay)
    with page.expect_request("**/report-*.html"):
        served.call(served.gateway.show_report, PageFile("text/html", b""))
    for number in range(1, 6):
        served.call(served.gateway.refuse, "paths that do not exist")
        until(page, "Object.values(known.gateway.refused).at(0)", number)
    assert len(asked) == 1
    page.context.close()
    served.close()


@pytest.mark.parametrize(
    "meanwhile",
    [
        "alarm.say('states late 1')",
        "known.nodes.set('another', { ...known.nodes.get('pid'), name: 'another' })",
    ],
    ids=["an alarm", "another controller"],
)
def test_a_click_counts_though_the_page_moves_under_the_hand(opened, served, meanwhile):
    page = opened()
    (acts,) = page.evaluate("() => known.run.acting")
    (other,) = {"pid", "fuzzy_pid"} - {acts}
    choice = f"#controllers input[value={other}]"
    box = page.locator(choice).bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.evaluate(f"() => {{ {meanwhile}; }}")
    for told in ("cleaned up", "deactivated"):  # something new, whatever it was before
        served.call(served.graph.event, other, told)
    page.wait_for_function(
        """([choice, { x, y }]) => {
            const now = document.querySelector(choice).getBoundingClientRect();
            return now.x !== x || now.y !== y;
        }""",
        arg=[choice, box],
    )
    page.evaluate(
        """() => {
            window.asked = [];
            wire.ask = (...asked) => { window.asked.push(asked); return { ok: true, text: "" }; };
        }"""
    )
    page.mouse.up()
    assert page.evaluate("() => window.asked") == [["swap", {"to": other}]]


def test_a_request_without_an_answer_is_said_to_have_none(opened, served):
    page = opened()
    page.evaluate("() => { WebSocket.prototype.send = () => {}; }")
    page.click("#reset")
    until(page, "document.getElementById('alarm-text').innerText", "reset: no answer yet")
    served.call(lambda: [one.send_away("cut off", 1001) for one in served.gateway.clients])
    until(page, "document.getElementById('alarm-text').innerText", "the connection was lost")
