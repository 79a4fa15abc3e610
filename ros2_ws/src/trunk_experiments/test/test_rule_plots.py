"""`trunk plot --memberships` and `--surface`: triangles, labels, surfaces and the run's way over them."""

import numpy as np
import pytest

from trunk_evidence.recorded_run import RecordedRun
from trunk_views.rule_plots import memberships, surface
from trunk_views.run_view import RunView


@pytest.fixture(scope="module")
def view(short_run):
    return RunView.read(RecordedRun.open(short_run("fig8", "fuzzy_pid")))


def texts(axes):
    return [text.get_text() for text in axes.texts]


@pytest.mark.slow
def test_triangles_have_their_peaks_labels_and_the_runs_inputs(view):
    figure = memberships(view)
    error, path, rate, _ = figure.axes
    config = view.controller
    assert texts(error) == list(config.axes.error)
    assert texts(rate) == list(config.axes.rate)
    tops = [line.get_xdata()[1] for line in error.lines]
    assert tops == pytest.approx(np.degrees(config.peaks[0]))
    way = path.lines[-1]
    assert way.get_xdata() == pytest.approx(np.degrees(view.terms.column("position", "error")))


@pytest.mark.slow
def test_a_surface_has_its_cells_and_the_runs_way(view):
    figure = surface(view)
    figure.draw_without_rendering()
    for axes, table in zip(figure.axes[::2], view.controller.tables, strict=True):
        cells = [text for i in range(7) for text in (row[i] for row in table.cells)]
        assert sorted(texts(axes)) == sorted(cells)
        assert axes.lines[-2].get_marker() == "o"
        above, right = axes.child_axes
        corner = above.get_xticklabels()[-1], right.get_yticklabels()[-1]
        assert [text.get_text() for text in corner] == ["PB", "PB"]
        top, side = (text.get_window_extent() for text in corner)
        assert top.x1 < side.x0
        assert side.y1 < top.y0
    assert [axes.get_title(loc="left") for axes in figure.axes[::2]][1:] == ["Kd′", "α"]


def test_what_cannot_be_drawn_is_refused_in_one_line(short_run, command_says, tmp_path):
    run = short_run("fig8", "pid")
    code, _, line = command_says("plot", run, "--surface", "-o", tmp_path / "a.png")
    assert code == 2
    assert "PID (Ziegler–Nichols) has no rules: give a run of fuzzy_pid or fuzzy" in line
    assert "give one run" in command_says("plot", run, run, "--surface")[2]
    assert not list(tmp_path.iterdir())
