"""Short runs, recorded offline, and one full of markup, for tests of this package and of those above it."""

from dataclasses import replace

import pytest

from trunk_core import topics
from trunk_recording.provenance import FORMAT
from trunk_recording.schemas import parameter_event
from trunk_recording.writer import END, PROVENANCE
from trunk_runs.offline_recording import record_offline
from trunk_runs.plan import make_plan

from ...trunk_recording.test.mcap_files import ANEW, content, write_file


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
    told = {"scenario": SCRIPT, QUOTES: CLOSE, "mode": QUOTES, "format": FORMAT}
    found.metadata[0] = (PROVENANCE, told)
    found.values(END).update(complete="false", reason=CLOSE)
    write_file(found, path, ANEW)
    return path


@pytest.fixture
def hostile_run(short_run, tmp_path):
    """Return a recording full of markup, in a file named like markup, and the words in it."""
    path = tmp_path / "<img src=x onerror=alert(4)>.mcap"
    return write_hostile(short_run("fig8", "fuzzy_pid"), path), WORDS
