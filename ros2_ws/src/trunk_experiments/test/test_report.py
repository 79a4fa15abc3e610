"""The report without a browser: data to the last bit, text escaped, nothing from elsewhere."""

import base64
import gzip
import hashlib
import json
import os
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.fuzzy import fired_rules
from trunk_evidence.doctor import INFO, findings
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.run_table import recorded_metrics
from trunk_experiments.cli import trunk
from trunk_msgs_util.picture import shapes
from trunk_recording.reader import Recording
from trunk_recording.writer import PROVENANCE
from trunk_runs.nodes import CONTROLLERS
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan
from trunk_sim.inputs import Applied
from trunk_views import report_data
from trunk_views.report_data import packed
from trunk_views.run_report import make_report, render, write
from trunk_views.run_view import RunView, rule_use, times_fired

from ...trunk_recording.test.mcap_files import ANEW, content, write_file
from ...trunk_sim.test.geometries import ARMS


def view_of(path):
    return RunView.read(RecordedRun.open(path))


def unpacked(columns):
    """Return columns by name, decoded independently of the page and of what wrote them."""
    plain = gzip.decompress(base64.b64decode(columns["data"]))
    planes = np.frombuffer(plain, np.uint8).reshape(8, -1)
    whole = np.ascontiguousarray(planes.T).view("<u8").reshape(-1, columns["count"])
    for _ in range(columns["differences"]):
        whole = np.cumsum(whole, axis=1, dtype="<u8")
    return {name: whole[place].view("<f8") for name, place in columns["places"].items()}


class Page(HTMLParser):
    """Elements, the text that a reader sees, and the content of each script."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.tags, self.words, self.scripts, self._in = [], [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._in = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._in = None

    def handle_data(self, data):
        if self._in == "script":
            self.scripts[-1] += data
        else:
            self.words.append(data)

    @property
    def data(self):
        return json.loads(self.scripts[0])


@pytest.fixture(scope="module")
def views(short_run):
    return [view_of(short_run("fig8", "pid")), view_of(short_run("fig8", "fuzzy_pid"))]


@pytest.fixture(scope="module")
def report(views):
    return make_report(views)


@pytest.fixture(scope="module")
def page(report):
    return Page(render(report))


@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=20))
def test_packing_keeps_every_bit(values):
    one, other = (np.array(column) for column in zip(*values, strict=True))
    back = unpacked(packed({"one": one, "other": other}.items()))
    assert (back["one"].tobytes(), back["other"].tobytes()) == (one.tobytes(), other.tobytes())


def test_equal_columns_are_written_once():
    t = np.arange(5000) / 1e3
    columns = packed({"t": t, "one": np.sin(t), "other": np.sin(t)}.items())
    assert columns["places"] == {"t": 0, "one": 1, "other": 1}


def test_a_smooth_curve_packs_to_less_than_half_its_size():
    wave = np.sin(np.arange(10_000) / 1e3)
    assert len(packed([("wave", wave)])["data"]) < len(base64.b64encode(wave.tobytes())) / 2


@given(st.lists(st.floats(allow_infinity=False), min_size=1, max_size=50), st.integers(2, 9))
def test_bins_keep_the_least_and_the_greatest_in_their_order(values, size):
    column = np.array(values)
    times = np.arange(len(column)) / 8.0
    back = unpacked(packed([("t", times), ("column", column)], size))
    assert (back["t"][0], back["t"][-1]) == (0.0, (len(column) - 1) / 8.0)
    for i, pair in enumerate(back["column"].reshape(-1, 2)):
        part = column[size * i : size * (i + 1)]
        known = part[~np.isnan(part)]
        if not len(known):
            assert np.isnan(pair).all()
            continue
        assert (pair.min(), pair.max()) == (known.min(), known.max())
        first, last = (
            int(np.flatnonzero(part == value)[0]) for value in (known.min(), known.max())
        )
        assert (pair[0] == known.min()) == (first <= last)


@pytest.mark.usefixtures("without_pictures")
def test_long_runs_are_reduced_and_say_so(views, monkeypatch):
    monkeypatch.setattr(report_data, "_EXACT_ROWS", 100)
    monkeypatch.setattr(report_data, "_BINNED_ROWS", 200)
    page = Page(render(make_report(views)))
    size = page.data["bin"]
    assert size == 27
    for view, run in zip(views, page.data["runs"], strict=True):
        assert run["columns"]["count"] == 2 * -(-len(view.table.t) // size)
        torque = unpacked(run["columns"])["torque"]
        assert (torque.min(), torque.max()) == (view.table.torque.min(), view.table.torque.max())
    assert f"of each {size} states" in " ".join(page.words)


def test_the_page_holds_every_value_of_every_run(views, page):
    assert page.data["bin"] == 1
    for view, run in zip(views, page.data["runs"], strict=True):
        table = view.table
        expected = {
            "t": table.t,
            "x": table.x,
            "theta": table.theta,
            "theta_dot": table.theta_dot,
            "torque": table.torque,
            "reference": table.reference,
            "measurement": table.theta_measured,
            "kp": table.kp,
            "ki": table.ki,
            "kd": table.kd,
            "alpha": table.alpha,
        }
        columns = unpacked(run["columns"])
        assert (
            columns.keys() - {"rules_e", "rules_rate", "rules_row", "rules_column"}
            == expected.keys()
        )
        for name, values in expected.items():
            assert columns[name].tobytes() == values.tobytes(), name
    (pulse,) = page.data["pulses"]
    assert (pulse["start"], pulse["end"]) == (1.0, 1.1)
    assert pulse["text"] == "+100° on the measured angle"
    assert pulse["runs"] == [0, 1]


@pytest.mark.usefixtures("without_pictures")
def test_runs_of_one_reference_share_its_line(views, short_run):
    own = view_of(short_run("fig7", "pid", settings=("pid.reference.step_time=0.5",)))
    data = make_report([*views, own]).data
    assert [run["reference"] for run in data["runs"]] == [0, 0, 2]
    assert [run["measured"] for run in data["runs"]] == [True, True, False]


def test_every_controller_is_offered_for_a_branch(page):
    assert f"with any controller ({', '.join(CONTROLLERS)}) and any" in " ".join(page.words)


@pytest.mark.usefixtures("without_pictures")
def test_the_page_has_each_runs_path(views, page, short_run):
    settings = ("simulator.path.cosines=[0.05]", "simulator.path.sines=[0.0, 0.1]")
    own = view_of(short_run("fig8", "pid", duration=0.2, settings=settings))
    (run,) = Page(render(make_report([own]))).data["runs"]
    track = {"amplitude": 1.0, "wavenumber": 1.0, "cosines": [0.05], "sines": [0.0, 0.1]}
    assert run["world"]["picture"]["track"] == track
    usual = page.data["runs"][0]["world"]["picture"]
    assert usual["track"] == track | {"cosines": [], "sines": []}
    assert [visual["page"] for visual in usual["visuals"]] == [0.0, 0.2, 0.26]


def test_a_plant_on_a_pivot_has_its_rates_instead_of_heights(views, monkeypatch):
    monkeypatch.setattr(shapes, "picture_of", lambda parameters: (ARMS, 0))
    views = [replace(view) for view in views]  # that have drawn nothing yet
    report = make_report(views)
    axes = report.pictures[0].axes[0]
    assert axes["of"] == ["x", "x_dot"]
    table = views[0].table
    assert axes["x"][0] < table.x.min() < table.x.max() < axes["x"][1]  # rad
    assert unpacked(report.data["runs"][0]["columns"])["x_dot"].tolist() == table.x_dot.tolist()
    assert report.data["runs"][0]["world"]["picture"]["track"] is None


def test_planes_are_pictures_with_their_axes(views, report):
    planes, surfaces = report.pictures
    assert [axes["of"] for axes in planes.axes] == [["x", "height"], ["theta", "theta_dot"]]
    assert [axes["runs"] for axes in planes.axes] == [[0, 1], [0, 1]]
    assert [axes["runs"] for axes in surfaces.axes] == [[1], [1], [1]]
    peaks = views[1].controller.peaks
    for axes in surfaces.axes:
        assert axes["x"] == pytest.approx([peaks[0][0], peaks[0][-1]])
        assert axes["y"] == pytest.approx([peaks[1][0], peaks[1][-1]])
    for picture in (planes, surfaces):
        kind, _, data = picture.source.partition(",")
        assert kind == "data:image/svg+xml;base64"
        assert base64.b64decode(data).startswith(b"<?xml")


def test_rules_are_counted(views):
    counts = np.array(rule_use(views[1]))
    terms = views[1].terms
    error, rate = terms.column("position", "error"), terms.column("position", "error_rate")
    peaks_e = np.array(views[1].controller.rules.error_peaks)
    peaks_r = np.array(views[1].controller.rules.rate_peaks)
    e, r = np.clip(error, peaks_e[0], peaks_e[-1]), np.clip(rate, peaks_r[0], peaks_r[-1])
    spacing_e, spacing_r = np.diff(peaks_e)[0], np.diff(peaks_r)[0]
    near_e = np.abs(e[:, None] - peaks_e) < spacing_e * (1 - 1e-12)
    near_r = np.abs(r[:, None] - peaks_r) < spacing_r * (1 - 1e-12)
    assert np.array_equal(counts, near_e.T.astype(int) @ near_r.astype(int))
    assert rule_use(views[0]) == []


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.floats(-1e3, 1e3) | st.just(np.nan), st.floats(-1e3, 1e3)), max_size=8)
)
def test_rules_are_counted_as_the_inference_fires_them(inputs):
    rules = make_plan("fig8", "fuzzy_pid").configs["fuzzy_pid"].rules
    inputs += [(e, r) for e in rules.error_peaks for r in rules.rate_peaks]
    expected = np.zeros((len(rules.error_peaks), len(rules.rate_peaks)), int)
    for error, rate in inputs:
        for rule in fired_rules(error, rate, rules):
            expected[rule.row, rule.column] += rule.weight > 0.0
    assert times_fired(*np.array(inputs).T, *rules[:2]) == expected.tolist()


@pytest.mark.usefixtures("without_pictures")
def test_an_operators_pushes_are_spans_with_their_greatest_values(tmp_path):
    settings = ("simulator.operator.torque=80.0", "simulator.operator.timeout=0.1")
    plan = make_plan("fig6", "pid", settings=settings, everywhere={"duration": 0.6})
    asked = ((100, 40.0), (150, -60.0), (400, 20.0))  # ms, N m
    pushes = tuple((ms * 1_000_000, Applied(0.0, torque)) for ms, torque in asked)
    record_offline(replace(plan, pushes=pushes), tmp_path / "pushed.mcap")
    data = make_report([view_of(tmp_path / "pushed.mcap")]).data
    (first, until), (second, _) = data["pushed"]
    assert (first, second) == (0.1, 0.4)
    assert until == pytest.approx(0.25, abs=0.011)
    marks = [(mark["t"], mark["words"]) for mark in data["marks"] if mark["kind"] == "push"]
    assert marks == [(0.1, "push, 60 N·m"), (0.4, "push, 20 N·m")]


def test_words_and_numbers_of_the_page(page):
    words = " ".join(page.words)
    for wanted in ("fig8-pid", "PID (Ziegler–Nichols)", "Fuzzy-PID", "Rules that", "gains.p_max"):
        assert wanted in words, wanted
    assert sum(tag == "canvas" for tag, _ in page.tags) == 1


def test_nothing_comes_from_elsewhere(page):
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert name not in {"srcset", "action"}, (tag, name)
            assert name != "src" or value.startswith("data:image/svg+xml;base64,")
            assert not name.startswith("on"), (tag, name)
            assert name != "href" or value.startswith("#")
            assert name != "style"
    assert not any(tag in {"link", "iframe", "object", "base"} for tag, _ in page.tags)


def test_the_policy_allows_only_these_scripts(page):
    (policy,) = (
        a["content"] for t, a in page.tags if a.get("http-equiv") == "Content-Security-Policy"
    )
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    digests = re.findall(r"'sha256-([^']+)'", rules["script-src"])
    expected = [hashlib.sha256(script.encode()).digest() for script in page.scripts[1:]]
    assert [base64.b64decode(digest) for digest in digests] == expected
    assert len(rules["script-src"].split()) == len(digests)  # and no other source
    assert not {"connect-src", "frame-src", "worker-src"} & rules.keys()


def test_hostile_words_are_text(hostile_run):
    path, hostile_words = hostile_run
    page = Page(render(make_report([view_of(path)])))
    words = " ".join(page.words)
    for word in hostile_words:
        assert word in words, word
    assert len(page.scripts) == 2
    assert {a["src"].partition(",")[0] for tag, a in page.tags if tag == "img"} == {
        "data:image/svg+xml;base64"
    }
    assert "<" not in page.scripts[0]


def test_damage_is_reported(short_run, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(short_run("fig8", "pid").read_bytes()[:-3000])
    report = make_report([view_of(path)])
    wanted = [f.describe() for f in findings(RecordedRun.open(path)) if f.severity != INFO]
    assert wanted
    fell, *others = report.runs[0].warnings
    assert fell.startswith("FELL")
    assert others == list(dict.fromkeys(wanted))
    words = " ".join(Page(render(report)).words)
    assert "cut, PID (Ziegler–Nichols), fig8: warnings" in words
    assert wanted[0] in words


@pytest.mark.usefixtures("without_pictures")
def test_doubts_come_first_and_a_sound_run_has_no_warnings(report, short_run):
    told = [section.warnings for section in report.runs]
    assert [len(lines) for lines in told] == [1, 1]
    assert all(lines[0].startswith("FELL: at t = 1.0") for lines in told)
    sound = make_report([view_of(short_run("fig6", "pid"))])
    assert sound.runs[0].warnings == ()


def test_what_was_read_whole_is_not_read_again(short_run, monkeypatch):
    path = short_run("fig8", "fuzzy_pid")
    usual = make_report([view_of(path)])
    run = RecordedRun.open(path)
    run.read_whole()
    tables = Recording.tables
    monkeypatch.setattr(
        Recording, "tables", lambda self, wanted: tables(self, wanted) if not wanted else 1 / 0
    )
    recorded_metrics(run)
    assert make_report([RunView.read(run)]) == usual


def test_the_command_and_its_size(short_run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = short_run("fig8", "fuzzy_pid", duration=10.0)
    done = CliRunner().invoke(trunk, ["report", str(run)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "fig8-fuzzy_pid.html").stat().st_size < 3_000_000


def test_the_page_is_opened_where_there_is_a_screen(trunk, short_run, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: not opened.append(address))
    for screen in ("", ":1"):
        monkeypatch.setenv("DISPLAY", screen)
        monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
        page = tmp_path / f"page{screen}.html"
        code, _, said = trunk("report", short_run("fig8", "pid"), "-o", page, "--open")
        assert code == 0
        line = f"trunk: warning: --open: there is no browser here: open {page.as_uri()}\n"
        assert said == ("" if screen else line)
    assert opened == [page.as_uri()]


def test_a_run_without_a_known_controller(short_run, tmp_path):
    found, path = content(short_run("fig8", "pid")), tmp_path / "bare.mcap"
    found.messages = found.of("/ground_truth/joint_states")
    found.values(PROVENANCE).clear()
    write_file(found, path, ANEW)
    words = " ".join(Page(render(make_report([view_of(path)]))).words)
    assert "No metrics" in words


def test_a_file_whose_name_is_no_text(short_run, tmp_path):
    folder = tmp_path / os.fsdecode(b"L\xe4ufe")
    folder.mkdir()
    source, page = folder / "0.mcap", tmp_path / "page.html"
    source.symlink_to(short_run())
    report = make_report([view_of(source)])
    write(report, page)
    text = unescape(page.read_text(encoding="utf-8"))
    assert r"/L\xe4ufe/0.mcap'" in text
