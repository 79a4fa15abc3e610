"""Pictures: every format, what each axes shows, and that it is the recorded data."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from trunk_core.errors import PlanError
from trunk_core.mechanics import path_height
from trunk_evidence.recorded_run import RecordedRun
from trunk_experiments.cli import trunk
from trunk_msgs_util.picture import shapes
from trunk_views.plots import COLORS, legend, line_style, overview, paper_figure, run_handles, save
from trunk_views.run_view import RunView, labels, off_scale

from ...trunk_sim.test.geometries import ARMS

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.fixture(scope="module")
def views(short_run):
    runs = (short_run("fig8", "pid"), short_run("fig8", "fuzzy_pid"))
    return [RunView.read(RecordedRun.open(run)) for run in runs]


def axes_of(figure, title):
    return next(axes for axes in figure.axes if axes.get_title(loc="left").startswith(title))


def has_line(axes, x, y):
    return any(
        np.array_equal(line.get_xdata(), x) and np.array_equal(line.get_ydata(), y)
        for line in axes.lines
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("suffix", MAGIC)
@pytest.mark.parametrize("draw", [overview, lambda views: paper_figure(views, 8)])
@pytest.mark.slow
def test_every_format_is_written_reproducibly(views, tmp_path, suffix, draw):
    path = tmp_path / f"a{suffix}"
    save(draw(views), path)
    first = path.read_bytes()
    assert first.startswith(MAGIC[suffix])
    save(draw(views), path)
    assert path.read_bytes() == first


def test_another_format_is_refused(views, tmp_path):
    with pytest.raises(PlanError, match=r"\.png, \.svg, \.pdf"):
        save(overview(views), tmp_path / "a.bmp")


def test_the_overview_shows_every_run_in_every_axes(views):
    figure = overview(views)
    for view in views:
        table = view.table
        angle = np.degrees(table.theta)
        assert has_line(axes_of(figure, "Trunk angle"), table.t, angle)
        assert has_line(axes_of(figure, "Torque"), table.t, table.torque)
        assert has_line(axes_of(figure, "Phase"), angle, table.theta_dot)
        for column, title in (("kp", "Gain $K_p"), ("ki", "Gain $K_i"), ("kd", "Gain $K_d")):
            assert has_line(axes_of(figure, title), table.t, getattr(table, column))
        assert has_line(axes_of(figure, "Ratio"), table.t, table.alpha)
    traveled = [line.get_xdata() for line in axes_of(figure, "Hip path").lines]
    x = views[0].table.x
    assert any(x.min() == line[0] and x.max() == line[-1] for line in traveled)


def test_the_path_is_drawn_with_its_harmonics(views, short_run):
    settings = ("simulator.path.cosines=[0.05]", "simulator.path.sines=[0.0, 0.1]")
    own = RunView.read(RecordedRun.open(short_run("fig8", "pid", duration=0.2, settings=settings)))
    axes = axes_of(overview([views[0], own]), "Hip path")
    paths = [(1.0, 1.0), (1.0, 1.0, (0.05, 0.0, 0.0, 0.1))]
    for line, path in zip(axes.lines[:2], paths, strict=True):
        x = line.get_xdata()
        assert line.get_ydata().tolist() == [path_height(one, *path) for one in x.tolist()]
    assert axes.get_ylabel() == "$y$ (m)"


def test_a_plant_on_a_pivot_has_a_phase_portrait_of_its_arm(views, monkeypatch):
    monkeypatch.setattr(shapes, "picture_of", lambda parameters: (ARMS, 0))
    views = [replace(view) for view in views]  # that have drawn nothing yet
    figure = overview(views)
    arm, pole = (a for a in figure.axes if a.get_title(loc="left").startswith("Phase"))
    assert (arm.get_xlabel(), pole.get_xlabel()) == ("angle $x$ (°)", r"angle $\theta$ (°)")
    table = views[0].table
    assert has_line(arm, np.degrees(table.x), table.x_dot)
    assert has_line(pole, np.degrees(table.theta), table.theta_dot)


def test_every_axes_has_units(views):
    for figure in (overview(views), paper_figure(views, 8)):
        for axes in figure.axes:
            assert "(" in axes.get_xlabel()
            assert "(" in axes.get_ylabel()


def test_the_reference_its_band_and_the_pulse_are_drawn_once(views):
    axes = axes_of(overview(views), "Trunk angle")
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == (-6.0, 6.0)
    (span,) = axes.patches
    assert (span.get_x(), span.get_x() + span.get_width()) == pytest.approx((1.0, 1.1), abs=1e-12)
    texts = [text.get_text() for text in overview(views).legends[0].get_texts()]
    assert "pulse acts" in texts
    assert "torque limits" not in texts  # the paper's profile has none


def test_a_pulse_that_acts_on_one_run_has_its_colour(views):
    pulse = views[0].pulses[0]._replace(start=0.25, end=0.5)
    one, other = replace(views[0], pulses=(*views[0].pulses, pulse)), views[1]
    figure = overview([other, one])
    (band,) = [p for p in axes_of(figure, "Trunk angle").patches if p.get_x() == 0.25]
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"pulse acts", "on one run, in its colour"} <= set(texts)
    assert band.get_facecolor()[:3] == to_rgb(line_style(1)["color"])


def test_torque_limits_are_drawn(short_run):
    view = RunView.read(RecordedRun.open(short_run("demo", "pid")))
    figure = overview([view])
    heights = [line.get_ydata()[0] for line in axes_of(figure, "Torque").lines]
    assert {-100.0, 100.0} <= set(heights)
    assert "torque limits" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_spike_is_cut_off_and_its_height_is_given(views):
    axes = axes_of(overview(views), "Torque")
    peak = max(np.abs(view.table.torque).max() for view in views)
    assert axes.get_ylim()[1] < peak / 2
    assert f"{peak:,.0f} N·m" in axes.get_title(loc="right")
    assert off_scale(np.sin(np.arange(100.0))) is None


@pytest.mark.slow
def test_no_legend_covers_data(views):
    for figure in (overview(views), paper_figure(views, 8)):
        figure.draw_without_rendering()
        (legend,) = figure.legends
        box = legend.get_window_extent()
        assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_a_legend_is_no_wider_than_its_figure():
    figure, names = Figure(figsize=(10.0, 4.0)), ["a run of a long name", "a" * 60, "b" * 30]
    legend(figure, "outside upper center", run_handles(names), run_handles(["reference"] * 5))
    (drawn,) = figure.legends
    assert drawn.get_window_extent().width <= figure.bbox.width
    assert {*names} < {text.get_text() for text in drawn.get_texts()}


def test_the_papers_layout_names_the_controllers(views, short_run):
    printed = RunView.read(RecordedRun.open(short_run("fig6", "pid", ("pid_as_printed",))))
    figure = paper_figure([printed, *views], 6)
    (axes,) = figure.axes
    assert axes.get_title(loc="left").startswith("Fig. 6")
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    wanted = {"PID (gains as printed)", "PID (Ziegler–Nichols) (fell)", "Fuzzy-PID (fell)"}
    wanted |= {"fell, in the run's colour"}
    assert not axes.texts, "nothing stands on the curves"
    assert wanted <= set(texts)


def test_runs_differ_in_colour_and_dashes():
    styles = [line_style(i) for i in range(5)]
    assert len({style["color"] for style in styles}) == 5
    assert len({str(style["linestyle"]) for style in styles}) == 5
    assert len({str(line_style(i)) for i in range(40)}) == 40
    assert len({line_style(i)["color"] for i in range(8)}) == 8
    assert len(set(COLORS)) == len(COLORS)


def test_names_are_distinct_and_not_read_as_mathematics(views, tmp_path, short_run):
    assert labels(views) == ["fig8-pid", "fig8-fuzzy_pid"]
    assert len(set(labels([views[0]] * 2))) == 2
    hostile = tmp_path / "_$x^$.mcap"
    hostile.write_bytes(short_run("fig8", "pid").read_bytes())
    figure = overview([RunView.read(RecordedRun.open(hostile))])
    figure.draw_without_rendering()
    assert r"_\$x^\$" in figure.legends[0].get_texts()[0].get_text()


@pytest.mark.slow
def test_the_command(short_run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = str(short_run("fig8", "pid"))
    assert CliRunner().invoke(trunk, ["plot", run]).exit_code == 0
    assert (tmp_path / "fig8-pid.png").stat().st_size > 10_000
    told = CliRunner().invoke(trunk, ["plot", run, "--fig", "6"])
    assert told.exit_code == 0
    assert "'fig8', not 'fig6'" in told.output
    assert (tmp_path / "fig6.png").exists()
    wrong = CliRunner().invoke(trunk, ["plot", run, "-o", "a.bmp"])
    assert wrong.exit_code == 1
    assert str(wrong.exception) == "--output a.bmp: the file's name must end in .png, .svg or .pdf"
