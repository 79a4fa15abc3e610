"""`trunk watch` as a user sees it: a recording in the live page, played, sought, looped."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from trunk_experiments.gateway.recorded_feed import RecordedFeed
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.plans.timeline import Change
from trunk_experiments.recorded.run import RecordedRun
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import topics

from .documents import checked

pytestmark = pytest.mark.browser

TRUNK = [sys.executable, "-c", "from trunk_experiments.executables import trunk; trunk()"]
THETA = "() => Array.from(known.plant.columns.get('theta').subarray(0, known.plant.count))"


@pytest.fixture
def watched(new_page):
    """Return a function that opens a recording in the page; nothing may go wrong in it."""
    started, pages, requests = [], [], []

    def go(path):
        process = subprocess.Popen(
            [*TRUNK, "watch", str(path), "--no-browser"],
            stdout=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        address = re.fullmatch(r"page: (\S+)\n", process.stdout.readline())[1]
        page = new_page(viewport={"width": 1400, "height": 900})
        pages.append(page)
        page.on("request", lambda request: requests.append(request.url))
        page.goto(address)
        page.wait_for_selector("html[data-ready]")
        return page

    yield go
    for page in pages:
        page.context.close()
    for process in started:
        process.send_signal(signal.SIGINT)
        assert process.wait() == 0
        process.stdout.close()
    assert all(url.startswith(("http://127.0.0.1:", "data:")) for url in requests), requests


@pytest.fixture(scope="module")
def swapped(tmp_path_factory):
    from trunk_experiments.plans.plan import Swap

    path = tmp_path_factory.mktemp("watch") / "swapped.mcap"
    swaps = [Swap(1.0, "fuzzy_pid"), Swap(2.8, "pid")]
    plan = make_plan("fig8", "pid", everywhere={"duration": 3.0}, swaps=swaps)
    record_offline(plan, path)
    return path


def test_a_recording_is_played_sought_and_looped(watched, swapped):
    page = watched(swapped)
    truth = RecordedRun.open(swapped).joints(topics.GROUND_TRUTH).by_stamp()
    page.wait_for_function(f"() => known.plant.count === {len(truth)}")
    assert page.evaluate(THETA) == truth.position[:, 1].tolist()
    # The rows of several controllers form one sequence, whichever come first.
    told = RecordedRun.open(swapped)
    stamps = [told.joints(f"{name}/state").stamp_ns for name in ("pid", "fuzzy_pid")]
    page.wait_for_function(f"() => known.control.count === {sum(map(len, stamps))}")
    times = page.evaluate("() => Array.from(known.control.t)")
    assert times == (np.sort(np.concatenate(stamps)) / 1e9).tolist()
    page.wait_for_function("() => view.time > 0.2")  # it plays
    page.click("#play")
    stopped = page.evaluate("() => view.time")
    assert page.locator("#pause").is_hidden()
    assert page.locator("#gains .knob:visible").count() > 0
    assert page.evaluate("() => document.documentElement.scrollHeight <= innerHeight")
    assert page.locator(".knob :is(input, select):enabled, .knob button:visible").count() == 0
    page.locator("#seek").fill("2.5")
    row = int(np.searchsorted(truth.stamp_ns, 2_500_000_000, side="right")) - 1
    page.wait_for_function("() => document.getElementById('time').textContent === '2.50 s'")
    shown = page.inner_text("[data-value=theta]").replace("−", "-").rstrip("°")
    assert float(shown) == pytest.approx(np.degrees(truth.position[row, 1]), rel=1e-3)
    assert page.evaluate("() => view.time") == 2.5 != stopped
    for key, time in (("ArrowRight", 2.51), ("Shift+ArrowLeft", 2.41), (".", 2.411)):
        page.keyboard.press(key)  # the report's keys
        assert page.evaluate("() => view.time") == pytest.approx(time, abs=1e-9), key
    lit = "document.querySelectorAll('#tables td[data-lit]').length"
    page.wait_for_function(f"() => {lit} > 0")  # fuzzy_pid acts
    page.keyboard.press("End")
    assert page.evaluate("() => view.time") == 3.0
    page.wait_for_function(f"() => {lit} === 0")  # pid acts again
    page.locator("#seek").fill("2.0")
    page.wait_for_function(f"() => {lit} > 0")
    page.locator("#seek").fill("0.5")
    page.wait_for_function(f"() => {lit} === 0")
    page.click("#branch")
    command = page.inner_text("#branch-command")
    assert command == f"trunk branch {swapped} --at 0.500 --controller fuzzy_pid -o what_if.mcap"
    page.check("#loop")
    page.select_option("#play-speed", "4")
    page.click("#play")
    page.wait_for_function("() => view.time > 2.5")
    page.wait_for_function("() => view.time < 1.0")  # again from the beginning
    page.uncheck("#loop")
    page.wait_for_function("() => view.time === known.recorded.last && !view.playing")


def test_parameters_are_those_at_the_time_shown(watched, tmp_path):
    values = {"gains.p_max": 90.0}
    changes = {
        "fuzzy_pid": (Change(1_000_000_000, values), Change(2_000_000_000, {"gains.d_min": 8.5}))
    }
    plan = make_plan("fig8", "fuzzy_pid", everywhere={"duration": 3.0})
    path = tmp_path / "retuned.mcap"
    record_offline(replace(plan, changes=changes), path)
    page = watched(path)
    page.click("#play")
    knobs = [page.locator(f"#gain-fuzzy_pid-gains-{name}") for name in ("p_max", "d_min")]
    for time, shown in (("2.5", ("90", "8.5")), ("0.5", ("60", "9.6")), ("1.5", ("90", "9.6"))):
        page.locator("#seek").fill(time)
        page.wait_for_function(
            "(time) => document.getElementById('time').textContent === `${time}0 s`", arg=time
        )
        assert tuple(knob.input_value() for knob in knobs) == shown
    page.click("#tab-happened")
    events = page.locator("#events li").all_inner_texts()
    assert "1.000 s fuzzy_pid: gains.p_max 60 → 90" in [
        re.sub(" +", " ", event) for event in events
    ]


def test_rules_are_hidden_while_their_parameters_are_not_known(watched, swapped):
    """A gateway knows the nodes before it knows their parameters."""
    page = watched(swapped)
    hidden = "() => { rules.show(); return document.getElementById('rules').hidden; }"
    assert page.evaluate(hidden) is False
    page.evaluate(
        """() => {
          known.run.acting = ["pid"];
          window.whole = known.nodes.get("fuzzy_pid");
          known.nodes.set("fuzzy_pid", { ...window.whole, parameters: {}, rules: null });
        }"""
    )
    assert page.evaluate(hidden) is True
    page.evaluate("() => known.nodes.set('fuzzy_pid', window.whole)")
    assert page.evaluate(hidden) is False


def test_an_incomplete_recording_says_so_first(watched, swapped, tmp_path):
    data = swapped.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    page = watched(cut)
    assert "incomplete" in page.inner_text("#alarm")
    assert "incomplete" in page.inner_text("#mode")


def test_hostile_words_stay_text(watched, hostile_run):
    path, _ = hostile_run
    page = watched(path)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.wait_for_function("() => known.plant.count > 0")
    assert page.evaluate("() => document.images.length") == 0
    assert page.evaluate("() => document.scripts.length") == 17


def test_a_broken_file_is_refused_before_anything_is_served(tmp_path):
    path = tmp_path / "none.mcap"
    path.write_bytes(b"nothing")
    done = subprocess.run(
        [*TRUNK, "watch", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "page:" not in done.stdout
    assert done.stderr.count("\n") == 1


def test_json_gives_the_address(swapped):
    process = subprocess.Popen(
        [*TRUNK, "watch", str(swapped), "--no-browser", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    lines = []
    while lines[-1:] != ["}\n"]:
        lines.append(process.stdout.readline())
    process.send_signal(signal.SIGINT)
    rest, words = process.communicate()
    assert (process.returncode, rest) == (0, "")
    document = checked("".join(lines), "page-1")
    assert document["address"] == document["watch_address"]
    assert document["address"] in words
    assert document["recording"] == str(swapped)


def test_the_rows_are_those_of_the_recording(swapped):
    feed = RecordedFeed(swapped)
    names = [stream.name for stream in feed.streams]
    assert names == ["plant", "pid", "fuzzy_pid"]
    fuzzy = feed.streams[2].rows
    weights = fuzzy.since(0, 10_000)[1][:, -4:]
    assert weights.sum(axis=1) == pytest.approx(1.0)
    pid = feed.streams[1].rows
    assert "w00" not in pid.names
    assert fuzzy.since(0, 1)[1][0, 0] >= 1.0
    assert pid.last()["t"] > 2.8 > fuzzy.last()["t"]
