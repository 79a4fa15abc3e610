"""Coefficients of a measured path: recovered from points made by them, and what points do not determine."""

from __future__ import annotations

import re
from math import pi

import numpy as np
import pytest
from click.testing import CliRunner

from trunk_experiments.cli import trunk
from trunk_experiments.errors import PlanError
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.tuning.gait import fit_path, read_points
from trunk_msgs_util.errors import TrunkError
from trunk_msgs_util.mechanics import path_height
from trunk_msgs_util.parameters.declarations import ParameterError

K = 2.0 * pi / 0.7
COSINES, SINES = (0.002, -0.012, 0.001), (-0.003, 0.0, 0.004)


def points(count=71, begin=0.2):
    x = begin + np.linspace(0.0, 0.7, count)
    waves = [n * K * x for n in (1, 2, 3)]
    y = sum(a * np.cos(w) + b * np.sin(w) for a, b, w in zip(COSINES, SINES, waves, strict=True))
    return x, 0.9 + y


def test_the_coefficients_that_made_the_points_are_recovered():
    fit = fit_path(*points(), harmonics=4)
    assert fit.wavenumber == pytest.approx(K, rel=1e-12)
    assert fit.cosines == pytest.approx((*COSINES, 0.0), abs=1e-12)
    assert fit.sines == pytest.approx((*SINES, 0.0), abs=1e-12)
    assert fit.rms < 1e-12
    assert fit.largest < 1e-12


def test_the_residual_is_what_the_series_leaves_out():
    x, y = points()
    fit = fit_path(x, y, harmonics=2, period=0.7)
    third = [path_height(one, 0.0, K, (*[0.0] * 4, COSINES[2], SINES[2])) for one in x.tolist()]
    assert fit.rms == pytest.approx(np.sqrt(np.mean(np.square(third))), rel=0.1)
    assert fit.largest >= fit.rms > 0.002


def test_several_periods_in_any_order_with_the_period_given():
    x, y = points(200)
    order = np.random.default_rng(1).permutation(200)
    moved = x + 0.7 * np.arange(200) % 2.1
    assert fit_path(moved[order], y[order], 3, period=0.7).rms < 1e-12


@pytest.mark.parametrize(
    ("x", "harmonics", "says"),
    [
        (np.linspace(0.0, 0.7, 6), 3, "6 points: 3 harmonics have 7 coefficients"),
        (np.zeros(9), 1, "the first x equals the last"),
        (np.linspace(0.0, 0.7, 7), 3, "determine 6 of the 7 coefficients"),
        (np.linspace(0.0, 0.001, 9), 1, "path.wavenumber"),
    ],
)
def test_what_the_points_do_not_determine_is_refused(x, harmonics, says):
    with pytest.raises(TrunkError, match=re.escape(says)) as caught:
        fit_path(x, np.sin(x), harmonics)
    assert len(str(caught.value).splitlines()) == 1


def test_coefficients_beyond_the_parameters_are_refused():
    x, y = points()
    with pytest.raises(ParameterError, match=r"path\.cosines"):
        fit_path(x, 1e6 * y, 3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x,y\n0.1,0.2\n0.2;0.3\n", "line 3: '0.2;0.3': give x and y in m"),
        ("0.1,0.2\n0.2,nan\n", "line 2: '0.2,nan'"),
        ("0,1\n" + "9" * 5000 + "\n", "line 2: '9999"),
        (b"\xff\xfe1,2\n", "not UTF-8 text"),
        ("x [kg],y\n1,2\n", "line 1: 'x [kg]': it is a mass"),
        ("0.1,0.2 m\n1,2\n", "line 1: '0.1,0.2 m': give x and y in m"),
        ("x [],y\n1,2\n", "line 1: 'x []'"),
        ("x,y,z\n1,2\n", "line 1: 'x,y,z': give x and y, two columns"),
    ],
)
def test_a_bad_line_is_named(tmp_path, text, says):
    file = tmp_path / "gait.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(PlanError, match=re.escape(says)):
        read_points(file)


@pytest.mark.parametrize("header", ["x [mm],y [cm]", " x (mm) , y (cm) "])
def test_the_units_of_the_header_count(tmp_path, header):
    file = tmp_path / "gait.csv"
    file.write_text(f"{header}\n0,100\n1500,-20\n")
    x, y = read_points(file)
    assert x == pytest.approx([0.0, 1.5], rel=1e-15)
    assert y == pytest.approx([1.0, -0.2], rel=1e-15)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(PlanError, match="no such file: give a CSV file of x and y"):
        read_points(tmp_path / "no.csv")


def test_columns_the_wrong_way_round_are_refused_with_a_hint():
    with pytest.raises(PlanError, match="x is the first column, in m"):
        fit_path(np.linspace(0.0, 0.002, 71), points()[0], 3)


def test_the_fitted_file_sets_the_plant_and_the_model(tmp_path):
    x, y = points()
    text = "x (m), y (m)\r\n" + "".join(
        f"{a!r}, {b!r}\r\n\r\n" for a, b in zip(x.tolist(), y.tolist(), strict=True)
    )
    (tmp_path / "gait.csv").write_text(text, encoding="utf-8-sig")
    words = [str(tmp_path / "gait.csv"), "--harmonics", "3", "-o", str(tmp_path / "walk.yaml")]
    result = CliRunner().invoke(trunk, ["fit", "path", *words])
    assert result.exit_code == 0, result.output
    assert "71 points: " in result.output
    plan = make_plan("fig6", "computed_torque", ["profile_walking", str(tmp_path / "walk.yaml")])
    fit = fit_path(x, y, 3)
    body = plan.simulator.body
    assert body == plan.controller.model._replace(prescribed=body.prescribed)
    assert (body.amplitude, body.wavenumber) == (0.0, fit.wavenumber)
    assert body.harmonics[::2] == fit.cosines
    assert body.harmonics[1::2] == fit.sines
    assert make_plan("fig6", "pid", [str(tmp_path / "walk.yaml")]).simulator.body == body._replace(
        prescribed=False
    )
