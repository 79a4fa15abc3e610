"""The report as a reader sees it: opened from disk in a headless Chromium without network access."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from trunk_control.fuzzy import fired_at
from trunk_core.mechanics import path_height
from trunk_evidence.recorded_run import RecordedRun
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import Swap, make_plan
from trunk_runs.timeline import Change
from trunk_views.run_report import make_report, write
from trunk_views.run_view import RunView, rule_places

from .page_driver import DESK, PHONE, across

pytestmark = pytest.mark.browser

T = "() => view.time"
RANGES = """() => [...strips.made.values()].filter(({ seen }) => seen)
    .map(({ plot }) => [plot.scales.x.min, plot.scales.x.max])"""


@pytest.fixture(scope="module")
def views(short_run):
    runs = (short_run("fig8", "pid"), short_run("fig8", "fuzzy_pid"))
    return [RunView.read(RecordedRun.open(run)) for run in runs]


@pytest.fixture(scope="module")
def file(views, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "two runs.html"
    write(make_report(views), path)
    return path


def recorded(plan, path):
    """Return the view of a run that is recorded into a file."""
    record_offline(plan, path)
    return RunView.read(RecordedRun.open(path))


def readout(page, run, name):
    text = page.inner_text(f"#readout-{run} [data-value={name}]")
    return float(re.match(r"[−\d.e+]+", text)[0].replace("−", "-"))


def row_at(view, time):
    return int(np.searchsorted(view.table.t, time + 1e-10, side="right")) - 1


def dots(page):
    """Return the places of the planes' dots, in percent of their pictures."""
    return page.evaluate(
        "() => [...document.querySelectorAll('.dot')].map(({ style }) => [style.left, style.top])"
    )


def shows(page, time):
    """Wait until everything shows a time."""
    page.wait_for_function(
        "(text) => document.getElementById('time').textContent === text", arg=f"{time:.3f} s"
    )


def test_scrubbing_moves_everything(opened, file, views):
    page = opened(file)
    assert page.evaluate(T) == 0.0
    before = dots(page)
    for wanted in (0.731, 1.05, 1.3):
        page.locator("#seek").fill(str(wanted))
        assert page.evaluate(T) == wanted
        shows(page, wanted)
        assert page.evaluate(
            "() => [...strips.made.values()].every(({ seen, time }) => !seen || time === view.time)"
        )
        assert dots(page) != before
        for run, view in enumerate(views):
            row = row_at(view, wanted)
            assert readout(page, run, "theta") == pytest.approx(
                np.degrees(view.table.theta[row]), rel=1e-3
            )
            assert readout(page, run, "torque") == pytest.approx(view.table.torque[row], rel=1e-3)
            assert readout(page, run, "x") == pytest.approx(view.table.x[row], rel=1e-3)
        before = dots(page)


def test_a_dot_stands_where_its_run_is(opened, file, views):
    page = opened(file)
    page.locator("#seek").fill("0.731")
    shows(page, 0.731)
    (path, phase) = page.evaluate("() => JSON.parse(document.querySelector('.plane').dataset.axes)")
    table, row = views[0].table, row_at(views[0], 0.731)
    height = path_height(table.x[row], 1.0, 1.0, None)
    places = [(path, table.x[row], height), (phase, table.theta[row], table.theta_dot[row])]
    for (left, top), (axes, x, y) in zip(dots(page)[::2], places, strict=False):
        parts = [(v - low) / (high - low) for v, (low, high) in ((x, axes["x"]), (y, axes["y"]))]
        box = axes["box"]
        assert float(left[:-1]) == pytest.approx(100 * (box[0] + parts[0] * box[2]), abs=1e-3)
        assert float(top[:-1]) == pytest.approx(100 * (box[1] + (1 - parts[1]) * box[3]), abs=1e-3)


def test_playing_moves_picture_and_slider(opened, file):
    """The page's time is the test's: on a busy machine the run would end between two looks."""
    page = opened(file)
    page.clock.install(time=0)
    page.clock.pause_at(1000)
    picture = "() => document.getElementById('scene').toDataURL()"
    before = page.evaluate(picture)
    page.click("#play")
    page.clock.run_for(300)
    assert page.inner_text("#play") == "Pause"
    page.click("#play")
    stopped = page.evaluate(T)
    assert stopped == pytest.approx(0.3, abs=0.1)
    assert page.inner_text("#play") == "Play"
    page.clock.run_for(150)
    assert page.evaluate(T) == stopped
    assert page.evaluate(picture) != before
    assert float(page.input_value("#seek")) == pytest.approx(stopped, abs=0.01)
    page.select_option("#play-speed", "4")
    page.click("#play")
    page.clock.run_for(200)
    assert page.evaluate(T) == pytest.approx(stopped + 0.8, abs=0.3)
    page.clock.run_for(300)
    assert page.evaluate("() => view.time === known.recorded.last && !view.playing")


def test_hovering_shows_all_digits_and_moves_the_time(opened, file, views):
    page = opened(file)
    for name, column in (("angle", np.degrees(views[0].table.theta)), ("kp", views[0].table.kp)):
        page.mouse.move(*across(page.locator(f"#strip-{name} .u-over"), 0.4))
        told = page.locator(f"#strip-{name} .told")
        told.wait_for()
        time = page.evaluate(T)
        row = int(np.flatnonzero(views[0].table.t == time)[0])  # a stamp, exactly
        words = told.inner_text().replace("−", "-")
        assert f"t = {time:.10g} s" in words
        assert float(re.search(r"fig8-pid (-?[\d.]+)", words)[1]) == pytest.approx(
            column[row], rel=1e-9
        )
        page.mouse.move(0, 0)
        assert told.is_hidden()


def test_a_click_goes_to_a_state(opened, file, views):
    page = opened(file)
    page.evaluate("() => { view.playing = true; view.speed = 0; }")
    page.mouse.click(*across(page.locator("#strip-angle .u-over"), 0.4321))
    assert not page.evaluate("() => view.playing")
    assert page.evaluate(T) > 0.0
    assert page.evaluate(T) in views[0].table.t


def test_the_data_in_the_page_are_the_recorded_bits(opened, file, views):
    page = opened(file)
    for run, view in enumerate(views):
        table = view.table
        for name, values in {
            "t": table.t,
            "theta": table.theta,
            "measurement": table.theta_measured,
            "torque": table.torque,
            "kp": table.kp,
        }.items():
            read = page.evaluate(
                "([run, name]) => Array.from(known.runs[run].plant.columns.get(name))", [run, name]
            )
            assert read == values.tolist(), name


def test_the_path_is_drawn_with_its_harmonics(reported, short_run):
    settings = ("simulator.path.cosines=[0.05]", "simulator.path.sines=[0.0, 0.1]")
    run = RecordedRun.open(short_run("fig8", "pid", duration=0.2, settings=settings))
    page = reported([RunView.read(run)])
    for x in (-3.1, 0.0, 0.4, 12.0):
        drawn = page.evaluate("(x) => pathHeight(known.runs[0].world.picture.track, x)", x)
        expected = path_height(x, 1.0, 1.0, (0.05, 0.0, 0.0, 0.1))
        assert drawn == pytest.approx(expected, abs=1e-14)


def drag(page, name, first, last, touch=""):
    """Drag over a chart, from and to parts of its width; ``touch``: a key that is held meanwhile."""
    target = page.locator(f"#strip-{name} .u-over")
    target.scroll_into_view_if_needed()
    # A chart that comes into sight is drawn in the next frame; a pointer over it moves the time.
    page.wait_for_function(f"() => strips.made.get('{name}').seen")
    page.evaluate(
        "() => new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))"
    )
    box = target.bounding_box()
    if touch:
        page.keyboard.down(touch)
    target.hover(
        position={"x": first * box["width"], "y": box["height"] / 2}
    )  # once it stands still
    page.mouse.down()
    page.mouse.move(*across(target, last), steps=4)
    page.mouse.up()
    if touch:
        page.keyboard.up(touch)


def test_zooming_and_moving_one_chart_does_it_to_all(opened, file):
    page = opened(file)
    drag(page, "kd", 0.3, 0.7)
    page.wait_for_function(
        f"() => ({RANGES})().every(([a, b]) => Math.abs(a - 0.39) < 0.02 && Math.abs(b - 0.91) < 0.02)"
    )
    drag(page, "angle", 0.7, 0.2, "Shift")
    page.wait_for_function(
        f"() => ({RANGES})().every(([a, b]) => Math.abs(a - 0.65) < 0.02 && Math.abs(b - 1.17) < 0.02)"
    )
    page.locator("#seek").fill("0.1")  # the charts follow the time
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a <= 0.1 && 0.1 <= b)")
    page.locator("#strip-angle .u-over").dblclick()
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0 && b === 1.3)")


def test_zooming_without_a_mouse(opened, file):
    page = opened(file, PHONE, has_touch=True, is_mobile=True)
    page.locator("#zoom-in").tap()
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0 && b === 0.65)")
    page.locator("#zoom-out").tap()
    page.wait_for_function(f"() => ({RANGES})().every(([a, b]) => a === 0 && b === 1.3)")
    page.locator("#strip-angle .u-over").tap()
    page.wait_for_function("() => Math.abs(view.time - 0.65) < 0.02")


def test_a_chart_is_saved_as_a_picture(opened, file, tmp_path):
    page = opened(file)
    with page.expect_download() as saved:
        page.click("#strip-torque .png")
    saved.value.save_as(tmp_path / "torque.png")
    assert saved.value.suggested_filename == "torque.png"
    data = (tmp_path / "torque.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    assert len(data) > 5_000


def test_short_peaks_are_cut_until_they_are_asked_for(opened, file, views):
    page = opened(file)
    high = "() => strips.made.get('torque').plot.scales.y.max"
    assert page.evaluate(high) < views[0].table.torque.max() / 2
    assert re.search(r"peaks up to \d+ off scale", page.inner_text("#strip-torque strong"))
    page.locator("#strip-torque .u-over").dblclick()
    page.wait_for_function(f"(peak) => ({high})() > peak", arg=views[0].table.torque.max())


def test_two_runs_are_side_by_side_on_a_desktop(opened, file):
    page = opened(file)
    left, right = (page.locator(f"#readout-{i}").bounding_box() for i in range(2))
    assert left["y"] == right["y"]
    assert left["x"] + left["width"] < right["x"]
    assert page.evaluate("() => scene.panes.length") == 2


def test_verdict_and_numbers_come_before_the_animation_and_that_before_the_charts(opened, file):
    for viewport in (DESK, PHONE):
        page = opened(file, viewport)
        order = page.evaluate(
            """() => {
              const names = [".verdicts", ".metrics", "#scene", "#live-charts", ".plane"];
              const all = names.map((name) => document.querySelector(name));
              const follows = (a, b) => a.compareDocumentPosition(b) & Node.DOCUMENT_POSITION_FOLLOWING;
              return all.every((e, i) => !i || follows(all[i - 1], e));
            }"""
        )
        assert order
        assert page.locator("#play").bounding_box()["y"] < viewport["height"]


def test_a_phone_shows_values_one_below_the_other(opened, file):
    page = opened(file, PHONE, has_touch=True, is_mobile=True)
    first, second = (page.locator(f"#readout-{i}").bounding_box() for i in range(2))
    assert first["x"] == second["x"]
    assert first["y"] + first["height"] < second["y"]


CUT = """() => [...document.querySelectorAll(".scroll table:not(.rules) :is(td, th)")].flatMap((cell) => {
    if (cell === cell.parentElement.cells[0]) return [];
    const range = document.createRange();
    range.selectNodeContents(cell);
    const text = range.getBoundingClientRect();
    const place = cell.closest(".scroll").getBoundingClientRect();
    const names = cell.parentElement.cells[0].getBoundingClientRect();
    const [from, to] = [Math.max(place.left, names.right) - 1, place.right + 1];
    const whole = from <= text.left && text.right <= to;
    return whole || text.right <= from + 2 || to - 2 <= text.left ? [] : [cell.innerText];
})"""


@pytest.mark.parametrize("runs", [1, 5])
def test_a_phone_shows_whole_values_however_long_a_name_is(reported, views, tmp_path, runs):
    named = []
    for i in range(runs):
        path = tmp_path / f"the_hip_swings_and_a_student_pushes_on_2026-11-28_{i}.mcap"
        shutil.copy(views[i % 2].path, path)
        named.append(RunView.read(RecordedRun.open(path)))
    page = reported(named, PHONE)
    for width in (320, 390, 430):
        page.set_viewport_size({"width": width, "height": 844})
        for scrolled in (0, 95, 10_000):
            page.evaluate(
                "(to) => document.querySelectorAll('.scroll').forEach((e) => e.scrollTo(to, 0))",
                scrolled,
            )
            assert page.evaluate(CUT) == []


@pytest.mark.parametrize("motion", ["reduce", "no-preference"])
def test_a_pulse_flashes_only_where_motion_is_welcome(opened, file, motion):
    page = opened(file, reduced_motion=motion)
    assert not page.evaluate("() => view.playing")  # nothing moves by itself
    page.locator("#seek").fill("1.05")
    shows(page, 1.05)
    filled = page.evaluate(
        """() => document.getElementById("scene").getContext("2d").getImageData(40, 80, 1, 1).data[3]"""
    )
    assert filled == (0 if motion == "reduce" else 255)


def test_a_fall_is_marked_in_the_animation_and_in_every_chart_over_time(reported, tmp_path):
    plan = make_plan("fig8", "fuzzy_pid", settings=["simulator.duration=1.5"])
    view = recorded(plan, tmp_path / "run.mcap")
    page = reported([view])
    fell = view.run.fall.stamp_ns / 1e9
    for time, words in (
        (fell - 0.01, "not yet"),
        (fell, f"at {fell:g} s"),
        (1.4, f"at {fell:g} s"),
    ):
        page.locator("#seek").fill(str(time))
        shows(page, time)
        assert page.inner_text("#readout-0 [data-value=fell]") == words
    assert page.evaluate("() => known.marks") == [{"t": fell, "kind": "fell", "words": "fell"}]


LIT = "document.querySelectorAll('.rules [data-lit]').length"


def test_a_swapped_run_lights_the_rules_of_whom_it_is_the_turn(reported, tmp_path):
    swaps = [Swap(1.0, "fuzzy_pid"), Swap(2.8, "pid")]
    plan = make_plan("fig8", "pid", everywhere={"duration": 3.0}, swaps=swaps)
    view = recorded(plan, tmp_path / "my run.mcap")
    page = reported([view])
    for time, fires, other in (
        (0.5, False, "fuzzy_pid"),
        (2.0, True, "pid"),
        (3.0, False, "fuzzy_pid"),
    ):
        page.locator("#seek").fill(str(time))
        shows(page, time)
        lit = page.evaluate(f"() => {LIT}")
        assert (1 <= lit <= 4) if fires else lit == 0
        assert page.inner_text("[data-branch]") == (
            f"trunk branch '{view.path}' --at {time:.3f} --controller {other} -o what_if.mcap"
        )
    # Those that fire, by the law's own function.
    page.locator("#seek").fill("2.0")
    shows(page, 2.0)
    row = int(np.searchsorted(view.terms.stamp_ns, 2_000_000_000, side="right")) - 1
    inputs = [float(view.terms.column("position", name)[row]) for name in ("error", "error_rate")]
    fired = fired_at(*inputs, *view.controller.peaks)
    assert page.evaluate(
        """() => [...document.querySelectorAll(".rules [data-lit]")].map((cell) =>
            [cell.parentElement.sectionRowIndex, cell.cellIndex - 1])"""
    ) == [[rule.row, rule.column] for rule in fired if rule.weight > 0.0]


def test_rules_fire_by_the_peaks_in_force(tmp_path):
    """Another range of the error during a run puts the same error elsewhere among the labels."""
    changes = (Change(1_000_000_000, {"fuzzy.error_range": 3.0}),)
    plan = make_plan("fig8", "fuzzy_pid", everywhere={"duration": 2.0})
    view = recorded(replace(plan, changes={"fuzzy_pid": changes}), tmp_path / "ranged.mcap")
    timeline, errors = view.run.timeline("fuzzy_pid"), view.terms.column("position", "error")
    places = rule_places(view, 0)
    for row, stamp_ns in enumerate(view.terms.stamp_ns.tolist()):
        timeline.advance(stamp_ns)
        peaks = timeline.config.peaks[0]
        expected = np.interp(errors[row], peaks, np.arange(len(peaks)))
        assert places[row] == pytest.approx(expected, abs=1e-9), stamp_ns


def test_parameters_are_those_at_the_time_shown(reported, tmp_path):
    changes = {
        "fuzzy_pid": (
            Change(1_000_000_000, {"gains.p_max": 90.0}),
            Change(2_000_000_000, {"gains.d_min": 8.5}),
        )
    }
    plan = make_plan("fig8", "fuzzy_pid", everywhere={"duration": 3.0})
    page = reported([recorded(replace(plan, changes=changes), tmp_path / "retuned.mcap")])
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    cells = [
        page.locator(f"[data-parameter='0 fuzzy_pid gains.{name}']") for name in ("p_max", "d_min")
    ]
    for time, shown in (
        ("2.5", ("90.0", "8.5")),
        ("0.5", ("60.0", "9.6")),
        ("1.5", ("90.0", "9.6")),
    ):
        page.locator("#seek").fill(time)
        shows(page, float(time))
        assert tuple(cell.inner_text() for cell in cells) == shown
    event = page.locator("tr", has_text="fuzzy_pid: gains.p_max 60 → 90").last
    event.locator("button").click()
    assert page.evaluate(T) == 1.0


def test_hostile_words_stay_text(opened, hostile_run, tmp_path):
    run, words = hostile_run
    path = tmp_path / "hostile.html"
    write(make_report([RunView.read(RecordedRun.open(run))]), path)
    page = opened(path)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    text = page.inner_text("body")
    for word in (*words, run.stem):
        assert word in text
    sources = "() => [...document.images].map(({ src }) => src.slice(0, 26))"
    assert set(page.evaluate(sources)) == {"data:image/svg+xml;base64,"}
    page.locator("#seek").fill("0.5")
    page.hover("#strip-angle .u-over")
