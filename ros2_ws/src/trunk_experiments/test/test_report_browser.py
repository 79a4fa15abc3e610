"""The report as a reader sees it: opened from disk in a headless Chromium without network access."""

from __future__ import annotations

import re

import numpy as np
import pytest

from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.runs.offline_recording import record_offline
from trunk_experiments.views.report import make_report
from trunk_experiments.views.report_page import write
from trunk_experiments.views.run_view import RunView
from trunk_msgs_util.mechanics import path_height

pytestmark = pytest.mark.browser

PHONE = {"width": 390, "height": 844}
T = "() => clock.time"


@pytest.fixture(scope="module")
def views(short_run):
    runs = (short_run("fig8", "pid"), short_run("fig8", "fuzzy_pid"))
    return [RunView.read(RecordedRun.open(run)) for run in runs]


@pytest.fixture(scope="module")
def file(views, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "two runs.html"
    write(make_report(views), path)
    return path


def cursor_times(page):
    """Return the time under each chart's cursor, read from where it stands."""
    return page.evaluate(
        """() => charts.filter((c) => c.timed).map((c) => {
            const { _size, xaxis } = c.target._fullLayout;
            return xaxis.p2d(parseFloat(c.cursor.style.left) - _size.l);
        })"""
    )


def readout(page, run, name):
    text = page.inner_text(f"#readout-{run} [data-value={name}]")
    return float(re.match(r"[−\d.e+]+", text)[0].replace("−", "-"))


def row_at(view, time):
    return int(np.searchsorted(view.table.t, time + 1e-10, side="right")) - 1


def test_scrubbing_moves_everything(opened, file, views):
    page = opened(file)
    assert page.evaluate(T) == 0.0
    for wanted in (0.731, 1.05, 1.3):
        page.locator("#scrub").fill(str(wanted))
        assert page.evaluate(T) == wanted
        times = cursor_times(page)
        assert len(times) == 7
        assert times == pytest.approx([wanted] * 7, abs=0.002)
        assert page.inner_text("#time") == f"{wanted:.3f} s"
        for run, view in enumerate(views):
            row = row_at(view, wanted)
            assert readout(page, run, "theta") == pytest.approx(
                np.degrees(view.table.theta[row]), rel=1e-3
            )
            assert readout(page, run, "torque") == pytest.approx(view.table.torque[row], rel=1e-3)
            assert readout(page, run, "x") == pytest.approx(view.table.x[row], rel=1e-3)


def test_playing_moves_cursor_picture_and_slider(opened, file):
    """The page's time is the test's: on a busy machine the run would end between two looks."""
    page = opened(file)
    page.clock.install(time=0)
    page.clock.pause_at(1000)
    picture = "() => document.getElementById('stage-0').toDataURL()"
    before = page.evaluate(picture)
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    page.clock.run_for(300)
    page.click("#play")
    stopped = page.evaluate(T)
    assert stopped == pytest.approx(0.3, abs=0.05)
    assert page.get_attribute("#play", "aria-label") == "Play"
    assert page.evaluate(picture) != before
    assert cursor_times(page) == pytest.approx([stopped] * 7, abs=0.002)
    assert float(page.input_value("#scrub")) == pytest.approx(stopped, abs=0.01)
    page.clock.run_for(150)
    assert page.evaluate(T) == stopped
    page.select_option("#speed", "4")
    page.click("#play")
    page.clock.run_for(200)
    assert page.evaluate(T) == pytest.approx(stopped + 0.8, abs=0.2)
    page.clock.run_for(200)
    assert page.evaluate("() => clock.time === report.end && !clock.playing")


def test_hovering_shows_the_data_and_moves_the_clock(opened, file, views):
    page = opened(file)
    for name, column in (("angle", np.degrees(views[0].table.theta)), ("kp", views[0].table.kp)):
        page.locator(f"#plot-{name}").scroll_into_view_if_needed()
        place = page.evaluate(
            """(id) => {
                const gd = document.getElementById(`plot-${id}`);
                const box = gd.getBoundingClientRect();
                const { _size, xaxis } = gd._fullLayout;
                gd.on("plotly_hover", ({ points }) => {
                    window.hovered = points.map((p) => [p.x, p.y, p.data.meta?.run]);
                });
                return [box.left + _size.l + xaxis.d2p(0.5), box.top + _size.t + _size.h / 2];
            }""",
            name,
        )
        page.mouse.move(*place)  # one move, one event: the chart shows what the event reports
        page.wait_for_function("() => window.hovered")
        page.locator(f"#plot-{name} .hovertext").first.wait_for(state="attached")
        points = {run: (x, y) for x, y, run in page.evaluate("() => window.hovered")}
        x, y = points[0]
        row = int(np.flatnonzero(views[0].table.t == x)[0])  # a stamp, exactly
        assert y == column[row]  # and its value, to the last bit
        texts = page.locator(f"#plot-{name} .hovertext").all_text_contents()
        shown = [
            float(re.sub("−", "-", re.search(r"[−-]?[\d.]+", text.rpartition(": ")[2])[0]))
            for text in texts
        ]
        assert any(value == pytest.approx(y, rel=1e-9) for value in shown), texts
        assert page.evaluate(T) == x
        assert cursor_times(page) == pytest.approx([x] * 7, abs=0.002)
        page.evaluate("() => { window.hovered = null; }")


def test_the_data_in_the_page_are_the_recorded_bits(opened, file, views):
    page = opened(file)
    for run, view in enumerate(views):
        drawn = page.evaluate(
            """(run) => {
                const gd = document.getElementById("plot-torque");
                return Array.from(gd.data.find((trace) => trace.meta?.run === run).y);
            }""",
            run,
        )
        assert drawn == view.table.torque.tolist()


def test_the_path_is_drawn_with_its_harmonics(opened, short_run, tmp_path):
    settings = ("simulator.path.cosines=[0.05]", "simulator.path.sines=[0.0, 0.1]")
    run = RecordedRun.open(short_run("fig8", "pid", duration=0.2, settings=settings))
    write(make_report([RunView.read(run)]), tmp_path / "own.html")
    page = opened(tmp_path / "own.html")
    for x in (-3.1, 0.0, 0.4, 12.0):
        drawn = page.evaluate("(x) => pathHeight(report.runs[0].path, x)", x)
        expected = path_height(x, 1.0, 1.0, (0.05, 0.0, 0.0, 0.1))
        assert drawn == pytest.approx(expected, abs=1e-14)


def test_zooming_one_chart_zooms_all(opened, file):
    page = opened(file)
    page.evaluate(
        "() => Plotly.relayout('plot-kd', { 'xaxis.range[0]': 0.4, 'xaxis.range[1]': 0.9 })"
    )
    ranges = "() => charts.filter((c) => c.timed).map((c) => c.target._fullLayout.xaxis.range)"
    page.wait_for_function(f"() => ({ranges})().every(([a, b]) => a === 0.4 && b === 0.9)")
    page.evaluate("() => clock.set(0.65)")
    assert cursor_times(page) == pytest.approx([0.65] * 7, abs=0.002)
    page.evaluate("() => clock.set(0.1)")  # outside what is shown
    assert page.locator(".cursor:visible").count() == 0


def test_keys(opened, file):
    page = opened(file)

    def press(key):
        page.keyboard.press(key)
        return page.evaluate(T)

    assert [press("ArrowRight"), press("ArrowRight")] == [0.01, 0.02]
    assert press("ArrowLeft") == 0.01
    assert press("Shift+ArrowRight") == 0.11
    assert press(".") == 0.111
    assert press(",") == 0.11
    assert press("End") == 1.3
    assert press("Home") == 0.0
    page.evaluate("() => { clock.speed = 0; }")  # so that it does not reach the end meanwhile
    press(" ")
    assert page.evaluate("() => clock.playing")
    press(" ")
    assert not page.evaluate("() => clock.playing")
    page.focus("#play")
    press(" ")  # a focused button is pressed once, not twice
    assert page.evaluate("() => clock.playing")
    press("Home")
    page.focus("#scrub")
    assert press("ArrowRight") == 0.01
    assert page.get_attribute("#scrub", "aria-valuetext") == "0.010 seconds"


def test_focus_is_visible_and_everything_has_a_name(opened, file):
    page = opened(file)
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.className") == "skip"
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.id") == "play"
    outline = "() => getComputedStyle(document.activeElement).outlineStyle"
    assert page.evaluate(outline) == "solid"
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("canvas, button, input, [role=region], figure")]
            .filter((e) => !e.getAttribute("aria-label") && !(e.matches("button") && e.textContent.trim()))
            .map((e) => e.outerHTML.slice(0, 80))"""
    )
    assert unnamed == []


def test_two_runs_are_side_by_side_on_a_desktop(opened, file):
    page = opened(file)
    left, right = (page.locator(f"#stage-{i}").bounding_box() for i in range(2))
    assert left["y"] == right["y"]
    assert left["x"] + left["width"] < right["x"]


def test_a_phone_shows_them_one_below_the_other(opened, file):
    page = opened(file, PHONE, has_touch=True, is_mobile=True)
    first, second = (page.locator(f"#stage-{i}").bounding_box() for i in range(2))
    assert first["x"] == second["x"]
    assert first["y"] + first["height"] < second["y"]
    assert page.evaluate("() => document.documentElement.scrollWidth") == 390


def test_dark_mode_and_print(opened, file):
    page = opened(file, color_scheme="dark")
    background = "() => getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(background) == "rgb(20, 23, 27)"
    ink = "() => document.getElementById('plot-angle')._fullLayout.font.color"
    assert page.evaluate(ink) == "#e9ecef"
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate(background) == "rgb(255, 255, 255)"
    page.wait_for_function(f"() => ({ink})() === '#000'")
    assert not page.locator("#controls").is_visible()


@pytest.mark.parametrize("motion", ["reduce", "no-preference"])
def test_a_pulse_flashes_only_where_motion_is_welcome(opened, file, motion):
    page = opened(file, reduced_motion=motion)
    assert not page.evaluate("() => clock.playing")  # nothing moves by itself
    page.evaluate("() => clock.set(1.05)")
    filled = page.evaluate(
        """() => document.getElementById("stage-0").getContext("2d").getImageData(20, 40, 1, 1).data[3]"""
    )
    assert filled == (0 if motion == "reduce" else 255)


def test_a_fall_is_marked_in_the_animation_and_in_every_chart_over_time(opened, tmp_path):
    plan = make_plan("fig8", "fuzzy_pid", settings=["simulator.duration=1.5"])
    record_offline(plan, tmp_path / "run.mcap")
    view = RunView.read(RecordedRun.open(tmp_path / "run.mcap"))
    path = tmp_path / "fell.html"
    write(make_report([view]), path)
    page = opened(path)
    fell = view.recording.fell_at_ns / 1e9
    for time, told in ((fell - 0.01, "not yet"), (fell, f"at {fell:g} s"), (1.4, f"at {fell:g} s")):
        page.evaluate(f"() => clock.set({time})")
        assert page.inner_text("#readout-0 [data-value=fell]") == told
    marked = """() => charts.filter((c) => c.timed).map((c) =>
        c.target.layout.shapes.filter((s) => s.type === "line" && s.x0 === report.runs[0].fell).length)"""
    assert set(page.evaluate(marked)) == {1}
    assert page.locator(".if-falls").is_visible()


def test_hostile_words_stay_text(opened, hostile_run, tmp_path):
    run, words = hostile_run
    path = tmp_path / "hostile.html"
    write(make_report([RunView.read(RecordedRun.open(run))]), path)
    page = opened(path)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    text = page.inner_text("body")
    for word in (*words, run.stem):
        assert word in text
    assert page.evaluate("() => document.images.length") == 0
    page.evaluate("() => clock.set(0.5)")
    page.hover("#plot-angle")
