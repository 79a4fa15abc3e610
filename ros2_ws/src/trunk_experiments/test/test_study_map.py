"""Maps render, with and without Floquet's line; controllers are compared over the same draws."""

import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from rich.cells import cell_len
from rich.console import Console

from trunk_core.errors import StudyError
from trunk_experiments.cli import trunk
from trunk_experiments.console import tables, terminal
from trunk_studies import stability_map as study_map
from trunk_studies.stability_map import axis_of, draw_curves, panels
from trunk_studies.statistics import (
    FELL,
    Falls,
    compare_study,
    difference_of,
    mean_and_median,
    wilson,
    worst_runs,
)
from trunk_studies.study import parse_study
from trunk_studies.sweep_execution import SweepJob, processes
from trunk_studies.sweep_results import Results

STUDY = """
scenario: fig6
params: profile_practical
rate: 200
duration: 4.0
controllers: [pid, fuzzy_pid]
runs: 3
set: {simulator.substeps: 1, simulator.hip.mode: prescribed, simulator.path.amplitude: 0.0}
vary:
  delay: {parameter: simulator.sensor.delay, from: 0.0, to: 0.3, steps: 4}
  gain: {parameter: [pid.gains.p, fuzzy_pid.gains.p_max], as: factor, values: [1.0, 1.5, 2.25, 3.375]}
  angle: {parameter: "simulator.initial.position[1]", distribution: uniform, low: 0.1, high: 0.4}
"""


START_AND_PUSH = """
scenario: demo
rate: 200
duration: 0.5
controllers: [pid, fuzzy_pid]
set: {disturbance.pulse.channel: trunk_effort, disturbance.pulse.start_times: [0.1]}
vary:
  start: {parameter: "simulator.initial.position[1]", from: -20deg, to: 20deg, steps: 3}
  push: {parameter: disturbance.pulse.magnitude, from: 5Nm, to: 20Nm, steps: 3}
"""


def swept(text, folder):
    sweep = SweepJob(parse_study(text, "study.yaml"), folder / "out.parquet")
    sweep.start()
    sweep.run(processes(1))
    sweep.finish()
    return sweep.output


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return swept(STUDY, tmp_path_factory.mktemp("map"))


@pytest.mark.one_in(4)
@pytest.mark.slow
def test_panels(path):
    found = panels(Results.read(path), "iae", ("delay", "gain"), with_floquet=True)
    assert [panel.controller for panel in found] == ["pid", "fuzzy_pid"]
    for panel in found:
        assert panel.values.shape == panel.growth.shape == (4, 4)
        assert np.all(panel.growth[:, 0] < 1.0)  # no delay: stable, and nobody falls
        assert np.all(panel.fallen[:, 0] == 0.0)
        assert np.all(panel.growth[:, 3] > 1.0)
        assert np.all(panel.fallen[:, 3] == 1.0)
        assert np.isnan(panel.values[0, 3])


@pytest.mark.slow
def test_a_map_has_the_magnitudes_that_are_compared(path):
    results = Results.read(path)
    metric = "steady_state_error_mean_deg"
    (pid, _) = panels(results, metric, ("delay",), with_floquet=False)
    runs = results.of("pid")
    stood = runs.only((runs.fallen == 0.0) & (runs.column("delay") == pid.x[0]))
    assert pid.values[0, 0] == pytest.approx(np.abs(stood.column(metric)).mean())


@pytest.mark.slow
@pytest.mark.parametrize(
    "more", [[], ["--no-floquet", "--metric", "iae", "--x", "gain", "--y", "delay"]]
)
def test_a_map_renders(path, tmp_path, more):
    target = tmp_path / "map.png"
    done = CliRunner().invoke(trunk, ["study", "map", str(path), "-o", str(target), *more])
    assert done.exit_code == 0, done.output
    assert target.read_bytes().startswith(b"\x89PNG")
    assert "2 controllers over" in done.output


@pytest.mark.slow
@pytest.mark.parametrize("with_floquet", [False, True])
def test_curves_draw_what_was_computed(path, with_floquet):
    results = Results.read(path)
    curves = panels(results, "iae", ("delay",), with_floquet)
    figure = draw_curves(curves, "iae", "delay", results.study, "")
    assert len(figure.axes) == 1 + with_floquet
    lines = {line.get_label(): line.get_xydata() for line in figure.axes[0].get_lines()}
    for curve in curves:
        runs = results.of(curve.controller)
        for k, delay in enumerate(curve.x):
            at = runs.only(runs.column("delay") == delay)
            fell = at.fallen.mean()
            x, y = lines[curve.controller][k]
            assert x == delay
            assert (
                np.isnan(y)
                if fell > 0.5
                else y == pytest.approx(np.mean(at.column("iae")[at.fallen == 0.0]), rel=1e-12)
            )
    crosses = [line.get_xdata() for line in figure.axes[0].get_lines() if line.get_marker() == "x"]
    assert list(map(list, crosses)) == [list(c.x[c.fallen[0] > 0.5]) for c in curves]
    if with_floquet:
        grown = [line.get_ydata() for line in figure.axes[1].get_lines()[: len(curves)]]
        assert np.array_equal(grown, [c.growth[0] for c in curves])


def test_an_axis_has_its_unit(path):
    study = Results.read(path).study
    assert axis_of(study, "delay") == ("delay (s)", 1.0)
    assert axis_of(study, "gain") == ("gain (factor)", 1.0)
    assert axis_of(study, "angle") == ("angle (°)", pytest.approx(180 / np.pi))


def test_a_table_of_somebody_elses_is_refused(tmp_path):
    pq.write_table(pa.table({"a": [1]}), tmp_path / "other.parquet")
    with pytest.raises(StudyError, match="not written by trunk sweep"):
        Results.read(tmp_path / "other.parquet")


def _changed(path, target, metadata=None, rows=slice(None)):
    table = pq.read_table(path)
    told = {**table.schema.metadata, **(metadata or {})}
    told = {name: value for name, value in told.items() if value is not None}
    indices = list(range(len(table)))[rows]
    pq.write_table(table.take(pa.array(indices, pa.int64())).replace_schema_metadata(told), target)
    return target


def test_damaged_results_give_one_line(path, tmp_path):
    target = tmp_path / "changed.parquet"
    for grid in (None, b"[", b"3", b"[3]"):
        with pytest.raises(StudyError, match="not written by trunk sweep"):
            Results.read(_changed(path, target, {b"grid": grid}))
    with pytest.raises(StudyError, match=r"changed\.parquet: there are no runs in it"):
        Results.read(_changed(path, target, rows=slice(0)))
    with pytest.raises(StudyError, match="'pid' and 'fuzzy_pid' do not have the same draws"):
        compare_study(Results.read(_changed(path, target, rows=slice(-1))))
    with pytest.raises(StudyError, match="there is no such file"):
        Results.read(tmp_path / "nix.parquet")
    for plans in (b"[", b"[3]", b"3", b"[]", b'[{"parameters": {"simulator": {"nix": 1}}}]'):
        results = Results.read(_changed(path, target, {b"plans": plans}))
        with pytest.raises(StudyError, match="this version does not understand"):
            results.bases()


def test_differences_are_over_the_same_draws(path):
    results = Results.read(path)
    rows = results.table.to_pylist()
    (fell, iae) = compare_study(results, ("iae",))
    assert (fell.metric, fell.pairs) == (FELL, 48)
    by_pair = {}
    fallen = dict(zip((row["run"] for row in rows), results.fallen, strict=True))
    for row in rows:
        by_pair.setdefault((row["point"], row["draw"]), {})[row["controller"]] = (
            None if fallen[row["run"]] else row["iae"]
        )
    expected = [
        pair["pid"] - pair["fuzzy_pid"] for pair in by_pair.values() if None not in pair.values()
    ]
    assert iae.pairs == len(expected) > 10
    assert iae.left_out == len(by_pair) - len(expected) > 0
    assert iae.mean == pytest.approx(np.mean(expected), rel=1e-12)
    assert iae.low < iae.mean < iae.high
    assert compare_study(results, ("iae",)) == [fell, iae]  # seeded


def test_intervals_cover_the_truth():
    """About 95 % of the 95 % intervals contain the known mean."""
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(100):
        a = rng.normal(1.0, 2.0, 60)
        d = difference_of("iae", "a", "b", a + rng.normal(0.3, 0.5, 60), a)
        inside += d.low <= 0.3 <= d.high
    assert 86 <= inside <= 100


@pytest.mark.parametrize(
    ("a", "b", "smaller"),
    [
        ([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 5.0, 0.0], 0.5),  # two ties, one smaller, one larger
        ([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 5.0], 0.625),
        ([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 0.0], 0.375),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.5),  # such as falls, where nobody falls
        ([0.0, 0.0], [1.0, 1.0], 1.0),
    ],
)
def test_a_tie_counts_half_for_each(a, b, smaller):
    first, second = np.array(a), np.array(b)
    assert difference_of("iae", "a", "b", first, second).smaller == smaller
    assert difference_of("iae", "b", "a", second, first).smaller == 1.0 - smaller


def test_a_metric_that_is_not_ranked_has_no_winner():
    a, b = np.linspace(-40.0, -30.0, 20), np.linspace(-20.0, -15.0, 20)
    assert difference_of("iae", "a", "b", a, b).verdict == "a smaller"
    angle = difference_of("theta_min_deg", "a", "b", a, b)
    assert (angle.verdict, angle.smaller_one) == ("not ranked", "")
    assert angle.mean < 0.0


@pytest.mark.parametrize("form", ["--json", "--csv", "--markdown", None])
def test_compare_prints(path, form):
    command = ["study", "compare", str(path), *([form] if form else [])]
    done = CliRunner().invoke(trunk, command)
    assert done.exit_code == 0, done.output
    if form == "--csv":
        assert done.output.splitlines()[1].startswith("fallen,pid,fuzzy_pid,0,48,")
    elif form == "--json":
        found = json.loads(done.output)
        assert found["differences"][0]["metric"] == "fallen"
        fallen = Results.read(path).of("pid").fallen
        assert found["falls"][0]["fell"] == np.sum(fallen == 1.0) > 0
        bins = found["distributions"][0]["histogram"]
        assert sum(bins["counts"]) == found["distributions"][0]["runs"]
        assert len(bins["edges"]) == len(bins["counts"]) + 1
    else:
        order = ("how often it fell", "mean and median", "first minus second", "histograms")
        assert sorted(order, key=done.output.index) == list(order)


def test_no_line_is_longer_than_a_narrow_terminal(path, monkeypatch):
    monkeypatch.setattr(tables, "screen_width", lambda: 80)
    monkeypatch.chdir(path.parent)  # the file's name is in a title
    done = CliRunner().invoke(trunk, ["study", "compare", path.name])
    assert max(map(cell_len, done.output.splitlines())) <= 80
    assert done.output.count("  where it did not fall  ") == 2  # no table is cut into several


def test_intervals_of_falls_are_wilsons():
    assert Falls("pid", 0, 100, 0, wilson(0, 100)).describe() == "0 of 100, up to 3.7 %"
    assert Falls("pid", 3, 400, 0, wilson(3, 400)).describe() == "3 of 400, 0.26 % to 2.2 %"
    assert Falls("pid", 9, 9, 1, wilson(9, 9)).describe() == "9 of 9, at least 70 %"
    assert Falls("pid", 0, 0, 9, wilson(0, 0)).describe() == "0 of 0"
    z, n, k = 1.959963984540054, 400, 3  # Wilson (1927), eq. for the bounds
    middle, half = (k + z * z / 2) / (n + z * z), z * np.sqrt(k * (n - k) / n + z * z / 4)
    assert wilson(3, 400).low == pytest.approx(middle - half / (n + z * z), rel=1e-9)


def test_mean_and_median_have_intervals_that_cover_them():
    rng = np.random.default_rng(3)
    inside = np.zeros(2)
    for _ in range(60):
        mean, median = mean_and_median(rng.exponential(2.0, 80))
        inside += mean.low <= 2.0 <= mean.high, median.low <= 2.0 * np.log(2.0) <= median.high
    assert all(inside >= 51)
    assert all(inside <= 60)
    assert not mean_and_median(np.array([1.0]))[1].known
    assert mean_and_median(np.array([2.0, 2.0]))[1] == (2.0, 2.0, 2.0)


def test_multipliers_are_computed_once_for_a_loop_that_no_axis_changes(tmp_path, monkeypatch):
    computed = []
    real = study_map.floquet
    monkeypatch.setattr(study_map, "floquet", lambda plan: computed.append(plan) or real(plan))
    results = Results.read(swept(START_AND_PUSH, tmp_path))
    found = panels(results, "overshoot_deg", ("start", "push"), with_floquet=True)
    assert len(computed) == len(found) == 2
    assert all(np.ptp(panel.growth) == 0.0 for panel in found)
    # Axes and runs have the units that were typed, and the legend what is drawn: nothing.
    figure = study_map.draw(found, "overshoot_deg", ("start", "push"), results.study, "")
    assert figure.axes[0].get_xlabel() == "start (°)"
    assert figure.axes[0].get_ylabel() == "push (N·m)"
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == [
        "not defined"
    ]  # of a trunk that begins upright; nobody falls, no line is there
    (worst,) = worst_runs(results, "overshoot_deg", 1)
    assert worst.varied["start"] in ("-20°", "0°", "20°")
    assert worst.varied["push"].endswith(" N m")


WALKING = """
scenario: fig6
params: profile_practical
rate: 200
duration: 2.5
controllers: [pid]
set: {simulator.hip.mode: prescribed, simulator.path.amplitude: 0.03}
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.01, 0.3]}
  gain: {parameter: pid.gains.p, as: factor, values: [1.0, 1.5]}
"""
MODE = "  mode: {parameter: simulator.hip.mode, values: [passive, prescribed]}\n"
ONE = WALKING[: WALKING.index("  gain:")]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    drawn = (
        "  delay: {parameter: simulator.sensor.delay, distribution: uniform, low: 0.0, high: 0.1}\n"
    )
    none = ONE[: ONE.index("  delay:")] + drawn
    for name, text in (("mine", WALKING), ("mode", ONE + MODE), ("one", ONE), ("none", none)):
        swept(text, tmp_path).rename(f"{name}.parquet")
    return tmp_path


def map_of(*arguments):
    done = CliRunner().invoke(trunk, ["study", "map", *map(str, arguments)])
    return done, f"{done.exception} {done.output}"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["mine.parquet", "-o", "x.jpg"], "x.jpg: the file's name must end in .png, .svg or .pdf"),
        (["mine.parquet", "-o", "none/x.png"], "there is no folder none"),
        (["mine.parquet", "--metric", "nix"], "no column 'nix': one of "),
        (["mine.parquet", "--metric", "status"], "'status' holds no numbers"),
        (["mine.parquet", "--x", "nix"], "'nix' is not a grid variable; available: delay, gain"),
        (["mine.parquet", "--x", "gain", "--y", "gain"], "--x and --y are both 'gain'"),
        (["mode.parquet", "--x", "mode"], "'mode' holds no numbers"),
        (
            ["one.parquet", "--y", "delay"],
            "--y delay: there is no other grid variable: give --x delay",
        ),
        (["none.parquet"], "a map needs one or two grid variables; it has none"),
        (["study.yaml"], "study.yaml: not a Parquet file: give the results of a trunk sweep"),
    ],
    ids=str,
)
def test_a_mistake_writes_nothing(here, arguments, line):
    (here / "study.yaml").write_text(WALKING)
    before = sorted(here.iterdir())
    done, told = map_of(*arguments)
    assert done.exit_code != 0
    assert line in told
    assert sorted(here.iterdir()) == before


def test_one_variable_gives_curves(here):
    done, message = map_of("one.parquet", "-o", "one.svg")
    assert done.exit_code == 0, message
    assert message.splitlines()[-1].endswith("one.svg: 1 controller over delay")
    picture = (here / "one.svg").read_text()
    for label in ("delay (s)", "steady-state error, RMS (°)", "more than half fell", "Floquet"):
        assert label in picture


@pytest.mark.slow
def test_a_picture_is_replaced_only_by_force(here):
    (here / "mine.png").write_text("mine")
    for named in ((), ("-o", "mine.png")):
        done, told = map_of("mine.parquet", *named)
        assert done.exit_code != 0
        assert "mine.png: it exists: give another name, or --force" in told
        assert (here / "mine.png").read_text() == "mine"
    done, told = map_of("mine.parquet", "--force")
    assert done.exit_code == 0, told
    assert (here / "mine.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_one_given_axis_leaves_the_other_variable_to_the_other_axis(here):
    _, told = map_of("mine.parquet", "--y", "delay")
    assert "over gain and delay" in told


@pytest.mark.slow
def test_a_terminal_shows_the_progress(here, monkeypatch):
    screen = io.StringIO()

    def wide(**_):
        return Console(file=screen, force_terminal=True, width=100)

    monkeypatch.setattr(terminal, "console", wide)
    monkeypatch.setattr(terminal, "_on_terminal", lambda: True)
    done, told = map_of("mine.parquet")
    assert done.exit_code == 0, told
    for text in ("Floquet multipliers", "100%"):
        assert text in screen.getvalue()
