"""What all pages do alike, whether live, a report or a lab: on each screen, in the dark, on paper, by key."""

import pytest
from ros2_ws.src.trunk_views.test.graph_double import ServedGraph
from ros2_ws.src.trunk_views.test.page_driver import (
    DESK,
    FITS,
    INK,
    NARROW,
    PHONE,
    opened,  # noqa: F401
    until,
)

from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.lab.webassembly import missing_tools
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_views.run_report import make_report, write
from trunk_views.run_view import RunView

from .lab.experiments import page_of

pytestmark = pytest.mark.browser

READY = {"live": ".rule-dot", "report": "html[data-ready]", "lab": "html[data-ready][data-whole]"}
every_page = pytest.mark.parametrize("name", READY)
dashboards = pytest.mark.parametrize("name", ["live", "lab"])
UNFOLD = "() => document.querySelectorAll('details').forEach((one) => { one.open = true; })"


@pytest.fixture(scope="module")
def addresses(tmp_path_factory):
    folder, served, views = tmp_path_factory.mktemp("pages"), ServedGraph(), []
    for law in ("pid", "fuzzy_pid"):
        record_offline(make_plan("fig8", law, everywhere={"duration": 1.3}), folder / f"{law}.mcap")
        views.append(RunView.read(RecordedRun.open(folder / f"{law}.mcap")))
    write(make_report(views), folder / "report.html")
    if not missing_tools():
        (folder / "lab.html").write_bytes(page_of("fig8", "--duration", "3"))
    pages = {name: (folder / f"{name}.html").as_uri() for name in ("report", "lab")}
    yield {"live": served.address, **pages}
    served.close()


@pytest.fixture
def shown(opened, addresses):  # noqa: F811
    """Return a function that opens a page, in which nothing moves by itself."""

    def go(name, **options):
        if name == "lab" and missing_tools():
            pytest.skip(missing_tools())
        return opened(addresses[name], ready=READY[name], reduced_motion="reduce", **options)

    return go


STEPS = {
    "live": ["#branch", "#tab-happened", "#tab-nodes"],
    "report": ["#play"],
    "lab": ["#branch", "#tab-numbers", "#save-experiment", "#copy-commands"],
}


@pytest.mark.one_in(3)
@every_page
def test_axe_has_no_complaint(shown, name):
    needed = "axe-playwright-python: scripts/bootstrap.sh"
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason=needed).Axe()
    page = shown(name, bypass_csp=True)
    for step in STEPS[name]:
        page.click(step)
        page.evaluate(  # the darkest a cell can be
            "() => document.querySelector('.rule-table td')?.style.setProperty('--weight', 1)"
        )
        for viewport, scheme in (
            (DESK, "light"),
            (DESK, "dark"),
            (PHONE, "light"),
            (PHONE, "dark"),
        ):
            page.set_viewport_size(viewport)
            page.emulate_media(color_scheme=scheme)
            page.wait_for_selector(READY[name], state="attached")
            found = axe.run(page).response
            assert [rule["id"] for rule in found["violations"]] == [], (step, viewport, scheme)
            assert len(found["passes"]) > 15


@every_page
def test_everything_has_a_name_and_focus_is_seen(shown, name):
    page = shown(name)
    page.evaluate(UNFOLD)
    named = """() => [...document.querySelectorAll("canvas, button, input, select, [role=region], figure")]
      .filter((e) => !e.ariaLabel && !(e.matches("button") && e.textContent.trim()))
      .filter((e) => !e.labels?.length && !e.closest(".uplot")).map((e) => e.outerHTML.slice(0, 80))"""
    assert page.evaluate(named) == []
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.className") == "skip"
    page.keyboard.press("Tab")
    outline = "() => getComputedStyle(document.activeElement).outlineStyle"
    assert page.evaluate(outline) == "solid"


SCREENS = [(1200, 720), (1200, 760), (1280, 800), (1280, 900), (1366, 768), (1920, 1080)]


@every_page
def test_no_screen_is_too_narrow_and_none_too_low_for_the_trunk(shown, name):
    page = shown(name)
    least = {"live": 200, "report": 0, "lab": 150}[name]
    for width, height in [*SCREENS, (390, 844), (320, 640)]:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function("() => scene.canvas.clientWidth <= innerWidth")
        assert page.evaluate(NARROW), width
        box = page.locator("#scene").bounding_box()
        if name != "report" and width > 1000 and (name, height) != ("lab", 720):
            assert box["height"] >= least, (width, height)
            assert box["y"] + box["height"] <= height, (width, height)
    page.evaluate(UNFOLD)
    assert page.evaluate(NARROW)


@dashboards
def test_on_a_desk_all_is_on_one_screen(shown, name):
    page = shown(name)
    page.click("#branch")
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        assert page.evaluate(FITS)
        assert page.locator("#live-charts .chart").count() == 5


PRINTED = """() => addEventListener("beforeprint", () => queueMicrotask(() => {
  window.printed = [...strips.made.values()].map(({ target, plot }) => ({
    room: target.clientWidth, width: plot.width, canvas: plot.ctx.canvas.clientWidth,
    ink: plot.axes[0].stroke(), fine: plot.ctx.canvas.width / plot.width,
    rows: plot.data[0].length, first: plot.data[0][0], last: plot.data[0].at(-1) }));
  const { canvas } = scene;
  window.stretched = canvas.width / canvas.clientWidth - canvas.height / canvas.clientHeight; }))"""


@every_page
def test_dark_is_dark_and_paper_is_white_with_whole_charts(shown, name):
    page = shown(name, color_scheme="dark")
    background = "() => getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(background) == "rgb(20, 23, 27)"
    assert page.evaluate(INK) == "#e9ecef"
    wide = page.evaluate("() => strips.made.get('angle').plot.width")
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate(background) == "rgb(255, 255, 255)"
    until(page, f"({INK})()", "#000")
    assert page.locator(".bar").is_hidden()
    page.emulate_media(media="screen", color_scheme="dark")
    until(page, f"({INK})()", "#e9ecef")
    page.evaluate(PRINTED)
    if name == "lab":  # what has just been changed is computed first
        page.evaluate("() => wire.take({ ...wire.setup, pushes: [[1e9, 20, 0], [1.1e9, 0, 0]] })")
    pages = page.pdf(format="A4").count(b"/Type /Page\n")
    assert name != "lab" or pages == 1
    for chart in page.evaluate("() => window.printed"):
        assert chart["width"] == chart["room"] == chart["canvas"] < 184 / 25.4 * 96  # mm to pixels
        assert chart["ink"] == "#000"
        assert chart["fine"] >= (2 if name == "report" else 1)
        if name != "live":
            assert chart["rows"] > 500
            assert (chart["first"], chart["last"]) == (
                0,
                pytest.approx(3 if name == "lab" else 1.3),
            )
    assert abs(page.evaluate("() => window.stretched")) < 0.02
    until(page, "strips.made.get('angle').plot.width", wide)
    assert page.evaluate(INK) == "#e9ecef"


@pytest.mark.parametrize(("name", "last"), [("report", 1.3), ("lab", 3.0)])
def test_keys_and_a_click_lead_through_the_time(shown, name, last):
    page = shown(name)
    assert page.evaluate("() => [view.playing, view.time]") == [False, 0]
    for key, time in (
        ("ArrowRight", 0.01),
        ("ArrowRight", 0.02),
        ("ArrowLeft", 0.01),
        ("Shift+ArrowRight", 0.11),
        (".", 0.111),
        (",", 0.11),
        ("End", last),
        ("Home", 0),
    ):
        page.keyboard.press(key)
        assert page.evaluate("() => view.time") == time, key
    page.locator("#strip-angle .u-over").click()
    assert page.evaluate("() => view.time") == pytest.approx(last / 2, abs=0.02)
    page.keyboard.press(" ")
    page.wait_for_function(  # in one step: a slow machine may be at the end before the next one
        """(time) => {
            if (!view.playing || view.time <= time) return false;
            const space = { key: " ", bubbles: true, cancelable: true };
            document.activeElement.dispatchEvent(new KeyboardEvent("keydown", space));
            return !view.playing;
        }""",
        arg=last / 2 + 0.1,
    )
    page.evaluate("() => { view.speed = 0; }")  # it does not reach the end meanwhile
    page.focus("#play")
    page.keyboard.press(" ")  # a focused button is pressed once, not twice
    assert page.evaluate("() => view.playing")


@dashboards
def test_the_tabs_are_reached_by_arrows(shown, name):
    page = shown(name)
    tabs = page.locator("[role=tab]").evaluate_all("all => all.map((tab) => tab.id)")
    page.focus(f"#{tabs[0]}")
    for key, place in (("ArrowRight", 1), ("End", -1), ("ArrowRight", 0), ("ArrowLeft", -1)):
        page.keyboard.press(key)
        assert page.evaluate("() => document.activeElement.id") == tabs[place]
        assert page.locator(f"[role=tabpanel][aria-labelledby={tabs[place]}]").is_visible()
        assert page.locator("[role=tabpanel]:visible").count() == 1


@dashboards
def test_a_rule_table_is_one_stop_of_the_tab_key(shown, name):
    page = shown(name)
    at = """() => {
      const cell = document.activeElement.closest('td');
      return [[...document.querySelectorAll('#tables table')].indexOf(cell?.closest('table')),
        cell?.parentElement.rowIndex, cell?.cellIndex]; }"""
    assert page.locator("#tables [role=grid]").count() == 3
    assert page.locator("#tables button[tabindex='0']").count() == 3
    page.focus("#collect")
    page.keyboard.press("Tab")
    assert page.evaluate(at) == [0, 1, 1]
    time = page.evaluate("() => { view.freeze(true); return view.time; }")
    for key, place in (
        ("ArrowRight", [0, 1, 2]),
        ("ArrowDown", [0, 2, 2]),
        ("End", [0, 2, 7]),
        ("ArrowRight", [0, 2, 7]),
        ("Home", [0, 2, 1]),
        ("ArrowLeft", [0, 2, 1]),
        ("Control+End", [0, 7, 7]),
        ("ArrowUp", [0, 6, 7]),
        ("Tab", [1, 1, 1]),
        ("Shift+Tab", [0, 6, 7]),
        ("Control+Home", [0, 1, 1]),
    ):
        page.keyboard.press(key)
        assert page.evaluate(at) == place, key
    assert page.evaluate("() => view.time") == time, "the keys are the table's alone"
    page.keyboard.press("Enter")
    page.wait_for_selector("#tables td[data-edited]")
    assert page.evaluate(at) == [0, 1, 1]
