from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from trunk_experiments.cli import main
from trunk_experiments.plans.plan import make_plan
from trunk_experiments.runs.offline_recording import record_offline
from trunk_msgs_util import topics
from trunk_msgs_util.recording.schemas import parameter_event
from trunk_msgs_util.recording.writer import END, PROVENANCE

from ...trunk_msgs_util.test.mcap_files import ANEW, content, write_file


@pytest.fixture(scope="session")
def short_run(tmp_path_factory):
    """Return a function that records a short run offline: ``short_run("fig8", "pid", ["file"])``."""
    made = {}

    def run(scenario="fig8", controller="fuzzy_pid", params=(), duration=1.3, settings=()):
        key = (scenario, controller, *params, duration, *settings)
        if key not in made:
            path = tmp_path_factory.mktemp("runs") / f"{scenario}-{controller}.mcap"
            plan = make_plan(scenario, controller, params, settings)
            plan = replace(plan, simulator=replace(plan.simulator, duration=duration))
            record_offline(plan, path)
            made[key] = path
        return made[key]

    return run


SCRIPT = "<script>alert(1)</script>"
CLOSE = "</script><script>alert(2)</script>"
QUOTES = "\"'><img src=x onerror=alert(3)><!--"
WORDS = (SCRIPT, CLOSE, QUOTES)


def write_hostile(source, path):
    """Copy a run in which every free text tries to break out of a page's text."""

    found = content(source)
    evil = f"/{SCRIPT}"
    found.channels[evil] = replace(found.channels[f"/{topics.RUN_PARAMETERS}"], id=99, topic=evil)
    data = parameter_event(0, f"/{CLOSE}", {SCRIPT: QUOTES, QUOTES: CLOSE}, {})
    found.messages += [[topic, 0, data, 0, 0] for topic in (f"/{topics.RUN_PARAMETERS}", evil)]
    told = {"scenario": SCRIPT, QUOTES: CLOSE, "mode": QUOTES}
    found.metadata[0] = (PROVENANCE, told)
    found.values(END).update(complete="false", reason=CLOSE)
    write_file(found, path, ANEW)
    return path


@pytest.fixture
def hostile_run(short_run, tmp_path):
    """Return a recording full of markup, in a file named like markup, and the words in it."""
    path = tmp_path / "<img src=x onerror=alert(4)>.mcap"
    return write_hostile(short_run("fig8", "fuzzy_pid"), path), WORDS


DRAWN = """
scenario: fig6
rate: 100
duration: 0.2
controllers: [pid]
vary:
  angle: {parameter: "simulator.initial.position[1]", distribution: uniform, low: 0.1, high: 0.4}
  mass: {parameter: simulator.plant.trunk_mass, distribution: uniform, low: 0.4, high: 0.6}
"""
STUDY = """
scenario: fig6
params: profile_practical
rate: 200
duration: 2.5
controllers: [pid, lqr]
set: {simulator.hip.mode: prescribed, simulator.path.amplitude: 0.03}
vary:
  delay: {parameter: simulator.sensor.delay, values: [0.0, 0.3]}
  gain: {parameter: pid.gains.p, as: factor, values: [1.0, 1.5]}
"""


@pytest.fixture
def command_says(monkeypatch, capfd):
    """Return a function that runs ``trunk`` and returns its exit code, stdout and stderr.

    What processes and libraries print is in them, too.
    """

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["trunk", *map(str, words)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as stop:
            main()
        captured = capfd.readouterr()
        return stop.value.code or 0, captured.out, captured.err

    return run


@pytest.fixture
def recordings_here(tmp_path, monkeypatch, short_run):
    """Go to a folder with two runs that fell, a sound one, two broken files and a study."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(short_run("fig8", "pid"), "a.mcap")
    shutil.copy(short_run("fig8", "fuzzy_pid"), "b.mcap")
    shutil.copy(short_run("fig6", "lqr"), "sound.mcap")
    Path("cut.mcap").write_bytes(Path("a.mcap").read_bytes()[:-40_000])
    Path("broken.mcap").write_bytes(b"nothing")
    Path("study.yaml").write_text(STUDY)
    Path("drawn.yaml").write_text(DRAWN)
    Path("gait.csv").write_text("0,0\n0.1,1\n0.2,0\n0.3,-1\n0.4,0\n0.5,1\n")
    return tmp_path


@pytest.fixture
def opened(new_page):
    """Return a function that opens a report; at the end there must be no requests and no console errors."""
    pages, requests = [], []

    def go(path, viewport=None, **options):
        page = new_page(viewport=viewport or {"width": 1440, "height": 900}, **options)
        pages.append(page)

        def answer(route):
            requests.append(route.request.url)
            if route.request.url == path.as_uri():
                route.continue_()
            else:
                route.abort()

        page.context.route("**/*", answer)
        page.goto(path.as_uri())
        page.wait_for_selector("html[data-ready]")
        return page

    yield go
    assert len(requests) == len(pages), requests  # each page itself, and nothing more
