"""Comparing in a report, and printing it: thin curves, hidden runs, a base run, zoom, names, paper."""

import numpy as np
import pytest

from trunk_evidence.recorded_run import RecordedRun
from trunk_views import report_data
from trunk_views.run_report import make_report, write
from trunk_views.run_view import RunView

pytestmark = pytest.mark.browser

SEEN = "[...strips.made.values()].filter(({ seen }) => seen)"
RANGES = f"() => {SEEN}.map(({{ plot }}) => [plot.scales.x.min, plot.scales.x.max])"
STOPS = """() => [...document.querySelectorAll("a[href], button, input, select, summary, [tabindex]")]
    .filter((e) => e.tabIndex >= 0 && !e.disabled)
    .filter((e) => e.checkVisibility({ contentVisibilityAuto: true })).length"""
CONTRASTS = """(selector) => {
    const light = (text) => {
        const part = text.match(/[\\d.]+/g).slice(0, 3).map((v) => {
            const share = v / 255;
            return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
        });
        return 0.2126 * part[0] + 0.7152 * part[1] + 0.0722 * part[2] + 0.05;
    };
    const card = light(getComputedStyle(document.querySelector(".card")).backgroundColor);
    return [...document.querySelectorAll(selector)].map((e) => {
        const ink = light(getComputedStyle(e).color);
        return Math.max(ink, card) / Math.min(ink, card);
    });
}"""


@pytest.fixture(scope="module")
def views(short_run):
    runs = (short_run("fig8", "pid"), short_run("fig6", "pid"))
    return [RunView.read(RecordedRun.open(run)) for run in runs]


@pytest.fixture(scope="module")
def file(views, tmp_path_factory):
    report = make_report(views)
    report.data["pushed"] = [[0.35, 0.5]]
    report.data["marks"] += [
        {"t": 0.3, "kind": "branch", "words": "branch (fig8-pid)"},
        {"t": 0.35, "kind": "push", "words": "push, 12 N·m (fig8-pid)"},
        {"t": 0.4, "kind": "turn", "words": "→ <b>other</b> (fig8-pid)"},
    ]
    path = tmp_path_factory.mktemp("report") / "two.html"
    write(report, path)
    return path


def drawn(page, name):
    """Return what a chart draws, in sight or not: its lines by label, each with times and values."""
    return page.evaluate(
        """async (name) => {
            strips.drawAll(view.time, false);
            await new Promise((done) => setTimeout(done));
            const { plot, lines } = strips.made.get(name);
            const values = plot.data.map((column) => Array.from(column));
            return lines.map(({ label }, i) => [label, values[0], values[i + 1]]);
        }""",
        name,
    )


def test_thin_curves_keep_every_extreme_and_zoomed_in_every_state(opened, file, views):
    """A long curve in the page's own store, with peaks that one state has, and a gap."""
    page = opened(file)
    page.evaluate(
        """() => {
            const { plant } = known.runs[0];
            const t = Float64Array.from({ length: 100000 }, (_, i) => i / 1000);
            const y = t.map((v, i) => (i === 31234 ? 50 : i === 77777 ? -50 : Math.sin(v)));
            y.fill(NaN, 5000, 5900);
            Object.assign(plant, { columns: new Map([["t", t], ["torque", y]]), count: t.length });
            known.recorded.last = 99.999;
            known.version += 1;
            view.zoom(0, 99.999);
        }"""
    )
    line = next(line for line in drawn(page, "torque") if line[0] == "fig8-pid")
    _, t, y = line
    known = [value for value in y if value is not None]
    assert len(known) <= 1400
    assert (min(known), max(known)) == (-50, 50)
    assert None in y
    assert t == sorted(t)
    page.evaluate("() => view.zoom(31, 31.5)")
    _, t, y = next(line for line in drawn(page, "torque") if line[0] == "fig8-pid")
    expected = np.sin(np.arange(31000, 31502) / 1000)
    expected[234] = 50
    inside = dict(zip(t, y, strict=True))
    stamps = (np.arange(31000, 31502) / 1000).tolist()
    assert [inside[stamp] for stamp in stamps] == pytest.approx(expected.tolist(), abs=1e-15)


def test_a_pulse_on_one_run_is_known_as_its_own(short_run):
    one, two = (RunView.read(RecordedRun.open(short_run("fig8", "fuzzy_pid"))) for _ in range(2))
    other = RunView.read(RecordedRun.open(short_run("fig6", "pid")))
    assert [pulse["runs"] for pulse in report_data.report_data([one, two])["pulses"]] == [[0, 1]]
    assert [pulse["runs"] for pulse in report_data.report_data([one, other])["pulses"]] == [[0]]


def test_runs_of_different_rates_keep_their_own_states(reported, views, short_run):
    slow = short_run("fig8", "pid", settings=("simulator.update_rate=500", "pid.update_rate=500"))
    other = RunView.read(RecordedRun.open(slow))
    page = reported([views[0], other])
    page.evaluate("() => view.zoom(0.2, 0.5)")
    found = [(t, y) for label, t, y in drawn(page, "angle") if "fig8-pid" in label]
    for view, (times, values) in zip((views[0], other), found, strict=True):
        own = {t: v for t, v in zip(times, values, strict=True) if v is not None}
        inside = (view.table.t >= 0.2) & (view.table.t <= 0.5)
        expected = np.degrees(view.table.theta[inside])
        assert [own[t] for t in view.table.t[inside].tolist()] == pytest.approx(expected.tolist())


def test_a_run_is_hidden_and_shown_by_its_entry(opened, file):
    page = opened(file)
    assert page.locator(".binned strong").count() == 0
    labels = "() => strips.made.get('angle').lines.map(({ label }) => label)"
    dots = "() => document.querySelectorAll('.dot:not([hidden])').length"
    assert {"fig8-pid", "fig6-pid"} <= set(page.evaluate(labels))
    assert page.evaluate(dots) == 4
    entry = page.locator("button.toggle").nth(1)
    entry.click()
    assert entry.get_attribute("aria-pressed") == "false"
    page.wait_for_function(f"() => !({labels})().includes('fig6-pid')")
    assert "fig6-pid" not in page.inner_text("#strip-angle figcaption")
    page.wait_for_function(f"() => ({dots})() === 2")
    entry.press("Space")  # which does not play
    assert not page.evaluate("() => view.playing")
    page.wait_for_function(f"() => ({labels})().includes('fig6-pid')")


def test_a_base_run_is_subtracted_from_the_others(opened, file, views):
    page = opened(file)
    charts = page.locator("#strip-difference-theta, #strip-difference-torque")
    assert charts.count() == 0
    page.select_option("#base", "0")
    page.locator("#strip-difference-torque").scroll_into_view_if_needed()
    assert charts.count() == 2
    assert "less that of fig8-pid" in page.inner_text("#strip-difference-theta")
    page.evaluate("() => view.zoom(0.9, 1.2)")
    ((label, times, values),) = drawn(page, "difference-torque")
    assert label == "fig6-pid"
    inside = np.isin(views[1].table.t, times)
    expected = views[1].table.torque - views[0].table.torque
    assert values == expected[inside].tolist()
    errors = page.evaluate("() => Array.from(known.runs[1].plant.columns.get('error'))")
    assert errors == (views[1].table.reference - views[1].table.theta).tolist()
    page.select_option("#base", "")
    charts.first.wait_for(state="detached")
    assert charts.count() == 0


def test_the_wheel_zooms_with_ctrl_and_keys_zoom_about_the_time(opened, file):
    page = opened(file)
    page.locator("#strip-angle .u-over").hover()
    page.mouse.wheel(0, 10)
    page.locator("#strip-torque .u-over").hover()
    page.keyboard.down("Control")
    page.mouse.wheel(0, -120)
    page.keyboard.up("Control")
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => b - a < 1.0 && a > 0)")
    page.locator("#seek").fill("0.5")
    page.keyboard.press("0")
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0 && b === 1.3)")
    page.keyboard.press("+")
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0.25 && b === 0.9)")


def test_events_are_named_once_above_the_curves_of_the_first_chart(opened, file):
    """Where the texts are drawn, as the canvas is told."""
    page = opened(file)
    names = page.evaluate(
        """() => {
            const texts = (name) => {
                const { ctx } = strips.made.get(name).plot;
                const found = [];
                const fill = ctx.fillText;
                ctx.fillText = (text, x, y) => {
                    found.push({ text, x, y, width: ctx.measureText(text).width });
                };
                strips.made.get(name).plot.redraw(false);
                return new Promise((done) => queueMicrotask(() => { // after uPlot's own, which draws
                    ctx.fillText = fill;
                    done(found.filter(({ text }) => /[a-z]/.test(text) && text !== "time, s"));
                }));
            };
            return Promise.all([texts("angle"), texts("torque")]);
        }"""
    )
    first, second = names
    assert {name["text"] for name in first} == {
        "branch (fig8-pid)",
        "fell (fig8-pid)",
        "push, 12 N·m (fig8-pid)",
        "→ <b>other</b> (fig8-pid)",
    }
    assert second == []
    for i, one in enumerate(first):
        for other in first[i + 1 :]:
            left, right = sorted((one, other), key=lambda name: name["x"])
            if one["text"] != other["text"] and one["y"] == other["y"]:
                assert left["x"] + left["width"] <= right["x"]
    assert "an operator pushes" in page.inner_text("#strip-angle figcaption")


def test_everything_is_drawn_once_the_page_has_loaded(browser, file):
    context = (
        browser.new_context()
    )  # the script fails in the frame that the page has while it loads
    page = context.new_page()
    page.add_init_script(
        """addEventListener("load", () => {
            const drawn = [...strips.made.values()].every(({ plot }) => plot.data[0].length);
            window.atLoad = [document.documentElement.dataset.ready, drawn];
        })"""
    )
    page.goto(file.as_uri())
    assert page.wait_for_function("() => window.atLoad").json_value() == ["true", True]
    assert page.locator("iframe").count() == 0
    context.close()


def test_eight_runs_are_told_apart_by_eye_and_by_keys(opened, views, tmp_path):
    write(make_report([views[0]] * 8), tmp_path / "eight.html")
    page = opened(tmp_path / "eight.html")
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        looks = page.evaluate("() => known.runs.map((_, i) => `${runColor(i)} ${runDash(i)}`)")
        assert len({look.split()[0] for look in looks}) == 8
        assert page.evaluate(STOPS) <= 40
        for selector in (".key", ".toggle", ".readout dd", ".num", ".binned", ".png"):
            ratios = page.evaluate(CONTRASTS, selector)
            assert min(ratios, default=0.0) >= 4.5, selector
