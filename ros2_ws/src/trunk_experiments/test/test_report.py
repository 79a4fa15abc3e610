"""The report without a browser: data to the last bit, text escaped, nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from trunk_control.fuzzy import fired_rules, infer
from trunk_experiments.cli import trunk
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.replay.doctor import INFO, examine
from trunk_experiments.runs.offline_recording import record_offline
from trunk_experiments.views import report_data
from trunk_experiments.views.packing import packed, packed_columns
from trunk_experiments.views.report import make_report
from trunk_experiments.views.report_page import render
from trunk_experiments.views.rule_use import rule_use, times_fired
from trunk_experiments.views.run_view import RunView
from trunk_msgs_util.recording.writer import PROVENANCE
from trunk_sim.operator_input import Applied

from ...trunk_msgs_util.test.mcap_files import ANEW, content, write_file


def view_of(path):
    return RunView.read(RecordedRun.open(path))


def unpacked(column, columns=None):
    """Return a column's doubles, decoded independently of the page and of what wrote it."""
    if "same" in column:
        return unpacked(columns[column["same"]])
    if "constant" in column:
        return np.full(column["count"], column["constant"])
    plain = zlib.decompress(base64.b64decode(column["packed"]), -15)
    kind = "<u4" if "step" in column else "<u8"
    planes = (
        np.frombuffer(plain, np.uint8).reshape(-1, column["count"]) if plain else np.empty((8, 0))
    )
    whole = np.ascontiguousarray(planes.T).view(kind).ravel()
    for _ in range(column["differences"]):
        whole = np.cumsum(whole, dtype=kind)
    if "step" not in column:
        return whole.view("<f8")
    steps = whole.view("<i4")
    values = column["low"] + steps * column["step"]
    values[steps == steps.max()] = column["high"]
    return np.where(steps < 0, np.nan, values)


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
def page(views):
    return Page(render(make_report(views)))


@given(st.lists(st.floats(), max_size=20))
def test_packing_keeps_every_value(values):
    array = np.array(values, np.float64)
    assert np.array_equal(unpacked(packed(array)), array, equal_nan=True)


def test_packing_distinguishes_the_zeros():
    assert np.signbit(unpacked(packed(np.array([0.0, -0.0])))).tolist() == [False, True]
    assert np.signbit(unpacked(packed(np.array([-0.0, -0.0])))).all()


def test_packing_in_steps_keeps_extremes_gaps_and_what_an_eye_sees():
    t = np.linspace(0.0, 10.0, 5001)
    wave = 30.0 * np.sin(t) + 1e-3 * np.sin(300.0 * t)
    wave[700] = 4000.0  # a peak does not make the rest coarse
    wave[100:120] = np.nan
    for bits in (24, 16):
        back = unpacked(packed(wave, bits))
        assert np.nanmax(back) == 4000.0
        assert np.nanmin(back) == np.nanmin(wave)
        assert np.array_equal(np.isnan(back), np.isnan(wave))
        assert np.nanmax(np.abs(back - wave)) <= 60.0 * 2.0**-bits
    for whole in (np.array([0.0, np.inf, 1.0]), np.array([0.0, 1e308, -1e308])):
        assert unpacked(packed(whole, 16)).tobytes() == whole.tobytes()  # no steps: exact


@given(st.lists(st.floats(), max_size=20), st.sampled_from([16, 20, 24]))
def test_packing_in_steps_keeps_the_range_of_any_values(values, bits):
    array = np.array(values, np.float64)
    back = unpacked(packed(array, bits))
    assert np.array_equal(np.isnan(back), np.isnan(array))
    known = array[~np.isnan(array)]
    if len(known):
        assert (np.nanmin(back), np.nanmax(back)) == (known.min(), known.max())


def test_equal_columns_are_written_once_and_times_are_always_exact():
    t = np.arange(5000) / 1e3
    columns = packed_columns({"t": t, "one": np.sin(t), "other": np.sin(t)}, 16)
    assert columns["other"] == {"same": "one"}
    assert unpacked(columns["t"]).tobytes() == t.tobytes()


def test_a_smooth_curve_packs_to_less_than_half_its_size():
    wave = np.sin(np.arange(10_000) / 1e3)
    assert len(packed(wave)["packed"]) < len(base64.b64encode(wave.tobytes())) / 2
    assert len(packed(wave, 24)["packed"]) < len(base64.b64encode(wave.tobytes())) / 10


def test_long_runs_are_rounded_and_say_so(views, monkeypatch):
    monkeypatch.setattr(report_data, "_EXACT_ROWS", 100)
    page = Page(render(make_report(views)))
    assert page.data["bits"] == 24
    for view, run in zip(views, page.data["runs"], strict=True):
        assert unpacked(run["columns"]["t"]).tobytes() == view.table.t.tobytes()
        back = unpacked(run["columns"]["torque"], run["columns"])
        assert (back.min(), back.max()) == (view.table.torque.min(), view.table.torque.max())
        assert (back != view.table.torque).any()
    assert "one part in 16,777,216" in " ".join(page.words)
    monkeypatch.setattr(report_data, "_MOST_TEXT", 100)
    assert Page(render(make_report(views))).data["bits"] == 16  # whatever its size


def test_the_page_holds_every_value_of_every_run(views, page):
    for view, run in zip(views, page.data["runs"], strict=True):
        table = view.table
        expected = {
            "t": table.t,
            "x": table.x,
            "theta": np.degrees(table.theta),
            "measured": np.degrees(table.theta_measured),
            "reference": np.degrees(table.reference),
            "rate": table.theta_dot,
            "torque": table.torque,
            "kp": table.kp,
            "ki": table.ki,
            "kd": table.kd,
            "alpha": table.alpha,
        }
        assert run["columns"].keys() == expected.keys()
        for name, values in expected.items():
            column = run["columns"][name]
            assert unpacked(column, run["columns"]).tobytes() == values.tobytes(), name
        (pulse,) = run["pulses"]
        assert (pulse["start"], pulse["end"]) == (1.0, 1.1)
        assert pulse["text"] == "+100° on the measured angle"


def test_the_page_has_each_runs_path(views, page, short_run):
    settings = ("simulator.path.cosines=[0.05]", "simulator.path.sines=[0.0, 0.1]")
    own = view_of(short_run("fig8", "pid", duration=0.2, settings=settings))
    (run,) = Page(render(make_report([own]))).data["runs"]
    path = {"amplitude": 1.0, "wavenumber": 1.0, "harmonics": [0.05, 0.0, 0.0, 0.1], "length": 1.0}
    assert run["path"] == path
    assert page.data["runs"][0]["path"] == path | {"harmonics": []}


def test_surfaces_equal_the_inference(views, page):
    pid, fuzzy = page.data["runs"]
    assert pid["fuzzy"] is None
    surface = fuzzy["fuzzy"]
    errors, rates = unpacked(surface["error"]), unpacked(surface["rate"])
    alpha = unpacked(surface["outputs"][2]["values"]).reshape(len(rates), len(errors))
    rules = views[1].controller.rules
    for i, j in ((0, 0), (7, 40), (60, 3)):
        expected = infer(np.radians(errors[j]), rates[i], rules)[2]
        assert alpha[i, j] == pytest.approx(expected, abs=1e-9)
    updates = surface["updates"]
    assert unpacked(updates["rate"], updates).tobytes() == (
        views[1].terms.column("position", "error_rate").tobytes()
    )


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


def test_an_operators_pushes_are_spans_with_their_greatest_values(tmp_path):
    settings = ("simulator.operator.torque=80.0", "simulator.operator.timeout=0.1")
    plan = make_plan("fig6", "pid", settings=settings, everywhere={"duration": 0.6})
    asked = ((100, 40.0), (150, -60.0), (400, 20.0))  # ms, N m
    pushes = tuple((ms * 1_000_000, Applied(0.0, torque)) for ms, torque in asked)
    record_offline(replace(plan, pushes=pushes), tmp_path / "pushed.mcap")
    (run,) = make_report([view_of(tmp_path / "pushed.mcap")]).data["runs"]
    first, second = run["pushes"]
    assert (first["start"], second["start"]) == (0.1, 0.4)
    assert first["end"] == pytest.approx(0.25, abs=0.011)
    assert (first["force"], first["torque"], second["torque"]) == (0.0, 60.0, 20.0)


def test_words_and_numbers_of_the_page(page):
    words = " ".join(page.words)
    for wanted in ("fig8-pid", "PID (Ziegler–Nichols)", "Fuzzy-PID", "Rules used", "gains.p_max"):
        assert wanted in words, wanted
    assert sum(tag == "canvas" for tag, _ in page.tags) == 2


def test_nothing_comes_from_elsewhere(page):
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert name not in {"src", "srcset", "action"}, (tag, name)
            assert not name.startswith("on"), (tag, name)
            assert name != "href" or value.startswith("#")
            assert name != "style"
    assert not any(tag in {"link", "img", "iframe", "object", "base"} for tag, _ in page.tags)


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
    assert len(page.scripts) == 3
    assert not any(tag == "img" for tag, _ in page.tags)
    assert page.data["runs"][0]["label"] == path.stem
    assert "<" not in page.scripts[0]


def test_damage_is_reported(short_run, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(short_run("fig8", "pid").read_bytes()[:-3000])
    report = make_report([view_of(path)])
    wanted = [f.describe() for f in examine(path) if f.severity != INFO]
    assert wanted
    fell, *others = report.runs[0].warnings
    assert fell.startswith("FELL")
    assert others == list(dict.fromkeys(wanted))
    words = " ".join(Page(render(report)).words)
    assert "cut: warnings" in words
    assert wanted[0] in words


def test_doubts_come_first_and_a_sound_run_has_no_warnings(views, short_run):
    told = [section.warnings for section in make_report(views).runs]
    assert [len(lines) for lines in told] == [1, 1]
    assert all(lines[0].startswith("FELL: at t = 1.0") for lines in told)
    sound = make_report([view_of(short_run("fig6", "pid"))])
    assert sound.runs[0].warnings == ()


def test_the_command_and_its_size(short_run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = short_run("fig8", "fuzzy_pid", duration=10.0)
    done = CliRunner().invoke(trunk, ["report", str(run)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "fig8-fuzzy_pid.html").stat().st_size < 3_000_000


def test_a_run_without_a_known_controller(short_run, tmp_path):
    found, path = content(short_run("fig8", "pid")), tmp_path / "bare.mcap"
    found.messages = found.of("/ground_truth/joint_states")
    found.values(PROVENANCE).clear()
    write_file(found, path, ANEW)
    words = " ".join(Page(render(make_report([view_of(path)]))).words)
    assert "No metrics" in words
