"""Comparing in a report, and printing it: thin curves, hidden runs, a base run, zoom, names, paper."""

from __future__ import annotations

import numpy as np
import pytest

from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.views import report_data
from trunk_experiments.views.report import make_report
from trunk_experiments.views.report_page import write
from trunk_experiments.views.run_view import RunView

from .test_report import unpacked

pytestmark = pytest.mark.browser

LABELS = "NB NM NS ZO PS PM PB".split()  # noqa: SIM905
RANGES = "() => charts.filter((c) => c.timed).map((c) => c.target._fullLayout.xaxis.range)"
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
    first = report.data["runs"][0]
    first["turns"].append({"start": 0.4, "controller": "<b>other</b>"})
    first["branch"] = 0.3
    first["pushes"] = [{"start": 0.35, "end": 0.5, "force": 0.0, "torque": 12.0}]
    path = tmp_path_factory.mktemp("report") / "two.html"
    write(report, path)
    return path


def test_thin_curves_keep_every_extreme_and_zoomed_in_every_state(opened, file):
    page = opened(file)
    found = page.evaluate(
        """() => {
            const t = Float64Array.from({ length: 100000 }, (_, i) => i / 1000);
            const y = t.map((v, i) => (i === 31234 ? 50 : i === 77777 ? -50 : Math.sin(v)));
            y.fill(NaN, 5000, 5300);
            const thin = thinned(t, y, 0, 99.999, 1000);
            const near = thinned(t, y, 31, 32, 1000);
            const plane = thinnedWay(t.map(Math.cos), y, { left: -1, right: 1, low: -50, high: 50 });
            return {
                count: thin.x.length, sorted: thin.x.every((v, i) => i === 0 || v > thin.x[i - 1]),
                real: thin.x.every((v, i) => Object.is(y[Math.round(v * 1000)], thin.y[i])),
                most: Math.max(...thin.y.filter(Number.isFinite)),
                least: Math.min(...thin.y.filter(Number.isFinite)),
                gaps: thin.y.some(Number.isNaN), near: near.x.length,
                plane: plane.length, peaks: [31234, 77777].every((i) => plane.includes(i)),
            };
        }"""
    )
    assert found.pop("count") <= 4000
    assert found.pop("plane") < 20000
    assert found.pop("near") >= 1000  # every state of that second
    assert found == {
        "sorted": True,
        "real": True,
        "most": 50,
        "least": -50,
        "gaps": True,
        "peaks": True,
    }


def test_every_state_that_is_handed_to_a_chart_is_drawn(opened, views, tmp_path):
    write(make_report(views[:1]), tmp_path / "one.html")
    found = opened(tmp_path / "one.html").evaluate(
        """() => [...chartsById.values()].filter((chart) => chart.drawn).map(({ id, target }) => {
            const handed = target._fullData.map(({ x }) => x.length);
            const vertices = [...target.querySelectorAll(".js-line")].map(
                (path) => path.getAttribute("d").match(/-?[\\d.]+,-?[\\d.]+|[HV]/g).length);
            return [id, Math.max(...handed), Math.max(...vertices)]; })"""
    )
    states = len(views[0].table.t)
    counts = {name: counts for name, *counts in found}
    assert counts["angle"] == [states, states]
    assert counts["torque"] == [states, 2 * states - 1]  # steps


def test_a_pulse_on_one_run_has_its_colour_and_surfaces_have_their_labels(
    opened, short_run, tmp_path
):
    one, two = (RunView.read(RecordedRun.open(short_run("fig8", "fuzzy_pid"))) for _ in range(2))
    report = make_report([one, two])
    report.data["runs"][1]["pulses"].append(
        {**report.data["runs"][1]["pulses"][0], "start": 0.2, "end": 0.3}
    )
    write(report, tmp_path / "own.html")
    page = opened(tmp_path / "own.html")
    bands = page.evaluate("() => markShapes().filter(({ type }) => type === 'rect')")
    colors = {band["x0"]: band["fillcolor"] for band in bands}
    assert colors[0.2] == page.evaluate("() => runColor(1)")
    assert colors[1.0] == page.evaluate("() => cssColor('--pulse')")
    texts = "({ target }) => target.layout.annotations.map(({ text }) => text)"
    found = page.evaluate(f"() => ({texts})(charts.find((one) => one.target.id === 'map-0-kp'))")
    assert found == [*LABELS, *LABELS]


def test_rounded_values_are_read_as_they_were_written(opened, views, tmp_path, monkeypatch):
    monkeypatch.setattr(report_data, "_EXACT_ROWS", 100)
    report = make_report(views[:1])
    write(report, tmp_path / "long.html")
    page = opened(tmp_path / "long.html")
    assert "16,777,216" in page.inner_text(".rounded")
    columns = report.data["runs"][0]["columns"]
    for name in ("t", "theta", "measured", "torque", "kp"):
        read = page.evaluate("(name) => Array.from(report.runs[0].columns[name])", name)
        assert read == unpacked(columns[name], columns).tolist(), name


def test_a_run_is_hidden_and_shown_by_its_entry(opened, file):
    page = opened(file)
    assert not page.locator(".rounded").is_visible()
    shown = """(run) => [...new Set(charts.flatMap((c) => c.target.data
        .filter((trace) => trace.meta?.run === run).map((trace) => trace.visible)))]"""
    dots = "() => document.querySelectorAll('#plot-phase .dot:not([hidden])').length"
    assert [page.evaluate(shown, run) for run in (0, 1)] == [[True], [True]]
    assert page.evaluate(dots) == 2
    entry = page.locator("button.toggle").nth(1)
    entry.click()
    assert entry.get_attribute("aria-pressed") == "false"
    assert [page.evaluate(shown, run) for run in (0, 1)] == [[True], [False]]
    assert page.locator("#chart-angle .value:visible").count() == 1
    assert page.evaluate(dots) == 1
    entry.press("Space")  # which does not play
    assert not page.evaluate("() => clock.playing")
    assert page.evaluate(shown, 1) == [True]


def test_a_base_run_is_subtracted_from_the_others(opened, file, views):
    page = opened(file)
    assert page.locator(".difference:visible").count() == 0
    page.select_option("#base", "0")
    page.wait_for_selector("#base[data-drawn='0']")
    assert page.locator(".difference:visible").count() == 2
    assert "less that of fig8-pid" in page.inner_text("#chart-difference-theta")
    drawn = page.evaluate(
        """() => document.getElementById("plot-difference-torque").data
            .map((trace) => [trace.meta.run, Array.from(trace.y)])"""
    )
    ((run, values),) = drawn
    assert run == 1
    assert values == (views[1].table.torque - views[0].table.torque).tolist()
    errors = page.evaluate("() => Array.from(report.runs[1].columns.error)")
    expected = np.degrees(views[1].table.reference) - np.degrees(views[1].table.theta)
    assert errors == expected.tolist()
    page.select_option("#base", "")
    page.wait_for_selector("#base[data-drawn='']")
    assert page.locator(".difference:visible").count() == 0


def test_the_wheel_zooms_with_ctrl_and_keys_zoom_about_the_time(opened, file):
    page = opened(file)
    page.locator("#plot-angle").hover()
    page.mouse.wheel(0, 10)
    page.keyboard.down("Control")
    page.locator("#plot-torque").hover()
    page.mouse.wheel(0, -120)
    page.keyboard.up("Control")
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => b - a < 1.0 && a > 0)")
    page.evaluate("() => clock.set(0.5)")
    page.keyboard.press("0")
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0 && b === 1.3)")
    page.keyboard.press("+")
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0.25 && b === 0.9)")


def test_events_are_named_once_above_the_first_plot(opened, file):
    page = opened(file)
    names = [
        text.strip() for text in page.locator("#plot-angle .annotation-text").all_text_contents()
    ]
    assert sorted(names) == [
        "branch (fig8-pid)",
        "fell (fig8-pid)",
        "push, 12 N·m (fig8-pid)",
        "→ <b>other</b> (fig8-pid)",
    ]
    assert page.locator("#plot-torque .annotation-text").count() == 0
    boxes = [box.bounding_box() for box in page.locator("#plot-angle .annotation-text").all()]
    for i, one in enumerate(boxes):
        for other in boxes[i + 1 :]:
            apart = abs(one["y"] - other["y"]) > 8
            assert apart or max(one["x"], other["x"]) >= min(
                b["x"] + b["width"] for b in (one, other)
            )
    for name in ("turns", "branches", "falls", "pushes"):
        assert page.locator(f".if-{name}").is_visible()


def test_paper_has_whole_plots_in_its_own_width_and_colours(opened, file):
    page = opened(file, color_scheme="dark")
    page.evaluate(
        """() => addEventListener("beforeprint", () => {
            window.printed = charts.map(({ target, timed }) => ({
                room: target.clientWidth, width: target._fullLayout.width, ink: target._fullLayout.font.color,
                svg: target.querySelector(".main-svg").getBoundingClientRect().width,
                range: timed ? target._fullLayout.xaxis.range : null,
            }));
        })"""
    )
    before = page.evaluate("() => charts[0].target._fullLayout.width")
    page.pdf(format="A4")
    for plot in page.evaluate("() => window.printed"):
        assert plot["width"] == plot["svg"] == plot["room"] < 184 / 25.4 * 96  # mm to pixels
        assert plot["ink"] == "#000"
        assert plot["range"] in (None, [0, 1.3])
    page.wait_for_function("(wide) => charts[0].target._fullLayout.width === wide", arg=before)
    assert page.evaluate("() => charts[0].target._fullLayout.font.color") == "#e9ecef"


def test_everything_is_drawn_once_the_page_has_loaded(browser, file):
    context = browser.new_context()
    page = context.new_page()
    page.add_init_script(
        """addEventListener("load", () => {
            window.atLoad = [document.documentElement.dataset.ready, charts.every((chart) => chart.drawn)];
        })"""
    )
    page.goto(file.as_uri())
    assert page.wait_for_function("() => window.atLoad").json_value() == ["true", True]
    assert page.locator("iframe").count() == 0
    context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_eight_runs_are_told_apart_by_eye_and_by_keys(opened, views, tmp_path, scheme):
    if not (path := tmp_path.parent / "eight.html").exists():
        write(make_report([views[0]] * 8), path)
    page = opened(path, color_scheme=scheme)
    looks = page.evaluate("() => report.runs.map((_, i) => `${runColor(i)} ${runDash(i)}`)")
    assert len({look.split()[0] for look in looks}) == 8
    assert page.evaluate(STOPS) <= 40
    for selector in (".values", ".toggle", ".readout dd", ".num", ".thinned"):
        ratios = page.evaluate(CONTRASTS, selector)
        assert min(ratios, default=0.0) >= 4.5, selector
