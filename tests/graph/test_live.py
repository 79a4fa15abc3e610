"""A person at the live page: what they do reaches the running graph, is on the record, and verifies."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trunk_core import topics
from trunk_evidence.judgement import verdict_on
from trunk_evidence.recorded_run import RecordedRun
from trunk_evidence.verdict import UNJUDGED, VERIFIED
from trunk_runs.processes import claimed_domain

from .live_page import LivePage, start_live
from .peer import Peer
from .processes import Children, until

pytestmark = [pytest.mark.graph, pytest.mark.browser]

MOST = 40.0  # N m, the most that `trunk live` lets a hand apply


def gateway_pid(child: Any) -> int:
    """Return the process of the gateway that a `trunk live` has started."""
    path = Path(f"/proc/{child.process.pid}/task/{child.process.pid}/children")

    def found() -> int | None:
        for pid in map(int, path.read_text().split()):
            if b"trunk_views.live" in Path(f"/proc/{pid}/cmdline").read_bytes():
                return pid
        return None

    return until(found, "a gateway")


def test_what_a_person_does_takes_effect_and_is_recorded(
    children: Children, peer: Peer, browser: Any, tmp_path: Path
) -> None:
    pushed = peer.hear(f"/{topics.OPERATOR_PUSH}")
    child, address, watch = start_live(
        children,
        *("demo", "--realtime", "--rate", "200", "--output", "run"),
        *("--controller", "fuzzy_pid", "--controller", "pid"),
        *("--set", "simulator.operator.timeout=2.0"),  # a busy page asks seldom
    )
    live = LivePage(browser, address)
    page = live.page
    live.until("known.run.started && known.run.acting.join() === 'fuzzy_pid'")
    live.until("known.control.columns.has('w11')")

    # Pull: a torque on the topic, within its limit, and the trunk follows.
    def until_it_leans() -> None:
        peer.until(lambda: any(message.effort[1] > 20.0 for message in pushed), "a push is taken")
        live.until("scene.places().theta > 3")

    live.pull("tip", 150, 0, until_it_leans)
    peer.until(lambda: pushed[-1].effort[1] == 0.0, "the hand lets go")
    assert max(abs(message.effort[1]) for message in pushed) <= MOST
    assert all(message.effort[0] == 0.0 for message in pushed if message.effort[1])
    # A key is a small push.
    page.focus("#scene")
    page.keyboard.down("ArrowLeft")
    peer.until(lambda: pushed[-1].effort[1] == pytest.approx(-0.3 * MOST), "a key pushes")
    page.keyboard.up("ArrowLeft")
    peer.until(lambda: pushed[-1].effort[1] == 0.0, "the key is up")

    # A parameter, as the node has it; and one that it refuses, in its words.
    knob = live.knob("fuzzy_pid", "gains.d_min")
    knob.fill("8.5")
    knob.press("Enter")
    live.until("known.nodes.get('fuzzy_pid').parameters['gains.d_min'] === 8.5")
    slider = page.locator("input[type=range][aria-label='fuzzy_pid gains.p_max']")
    slider.fill("70")
    live.until("known.nodes.get('fuzzy_pid').parameters['gains.p_max'] === 70")
    knob.fill("99")
    knob.press("Enter")
    page.wait_for_selector("#knobs .refused:not(:empty)")
    assert "gains.d_max" in page.inner_text("#knobs .refused:not(:empty)")
    assert live.get("known.nodes.get('fuzzy_pid').parameters['gains.d_min']") == 8.5

    # What is saved is a parameter file that would change nothing here.
    with page.expect_download() as download:
        page.click("#save")
    download.value.save_as(tmp_path / "saved.yaml")
    same = children.trunk("params", "apply", "fuzzy_pid", tmp_path / "saved.yaml", "--dry-run")
    assert same.wait() == 0, same.stderr
    assert "->" not in same.stdout
    events = "[...document.querySelectorAll('#events li')].map((one) => one.textContent)"
    for words in ("gains.d_min 9.6 → 8.5", "gains.p_max 60 → 70"):
        live.until(f"{events}.some((text) => text.endsWith('s  fuzzy_pid: {words}'))")
    page.click("#undo")  # the slider
    live.until("known.nodes.get('fuzzy_pid').parameters['gains.p_max'] === 60")
    other = children.trunk("params", "apply", "fuzzy_pid", tmp_path / "saved.yaml", "--dry-run")
    assert other.wait() == 0, other.stderr
    assert "gains.p_max: 60.0 -> 70" in other.stdout

    # A cell of the rules by a click; two as one change.
    cell = page.locator("#tables .rule-table").nth(0).locator("td button")
    cell.nth(0).click()
    live.until("known.nodes.get('fuzzy_pid').parameters['rules.kp'][0].startsWith('S ')")
    page.check("#collect")
    cell.nth(0).click()
    page.locator("#tables .rule-table").nth(2).locator("td button").nth(0).click()
    assert page.locator("td[data-changed]").count() == 2
    page.click("#apply")
    live.until("known.nodes.get('fuzzy_pid').parameters['rules.alpha'][0].startsWith('MS ')")
    assert live.get("known.nodes.get('fuzzy_pid').parameters['rules.kp'][0]").startswith("B ")

    # The reference by its ring.
    asked = "known.control.value('reference', known.control.count - 1)"
    live.pull("ring", 60, 0, lambda: live.until(f"{asked} > 0.05"))

    # Another page only watches; this one is reloaded.
    other = LivePage(browser, watch)
    other.until("known.gateway.clients === 2 && known.plant.count > 10")
    assert other.page.locator("#pause").is_hidden()
    page.reload()
    live.ready()
    live.until("known.plant.count > 10 && known.control_allowed")

    # Another controller, without a bump; pause and go on.
    page.click("#controllers input[value=pid]")  # checked once it acts
    live.until("known.run.acting.join() === 'pid'")
    page.click("#pause")
    live.until("known.run.paused")
    page.click("#pause")
    live.until("!known.run.paused")
    t = live.get("known.plant.last")
    live.until(f"known.plant.last > {t} + 0.5")
    other.until("known.gateway.clients === 2")
    assert live.complaints == other.complaints == []
    assert all(url.startswith(("http://127.0.0.1:", "data:")) for url in live.requests)

    # Stop, show report.
    page.click("#stop")
    page.wait_for_url("**/report-*.html", wait_until="domcontentloaded")
    assert "trunk report" in page.title()
    other.close()
    live.close()
    assert child.wait() == 0, child.stdout + child.stderr

    run = RecordedRun.open(tmp_path / "run" / "run.mcap")
    assert run.recording.complete, run.recording.end
    assert run.operated
    torques = np.array([applied.trunk_torque for _, applied in run.operated.pushes])
    assert torques.max() > 20.0
    assert np.abs(torques).max() <= MOST
    changed = {name for change in run.plan().changes["fuzzy_pid"] for name in change.values or ()}
    assert {"gains.d_min", "gains.p_max", "rules.kp", "rules.alpha", "reference.profile"} <= changed
    assert run.count("reference") > 0
    verdict = verdict_on(run)
    assert verdict.exit_code in (VERIFIED, UNJUDGED), verdict


def test_in_lockstep_which_is_the_default_the_page_chooses_the_speed_and_who_acts(
    children: Children, peer: Peer, browser: Any, tmp_path: Path
) -> None:
    child, address, _ = start_live(
        children,
        *("demo", "--controller", "fuzzy_pid", "--controller", "pid"),
        *("--output", "run", "--set", "simulator.lockstep.timeout=60"),
    )
    live = LivePage(browser, address)
    live.until("known.run.started && known.nodes.get('pid')?.state === 'inactive'")
    live.page.select_option("#lockstep-speed", "2")
    live.until("known.nodes.get('simulator').parameters['lockstep.speed'] === 2")
    live.page.click("#controllers input[value=pid]")  # checked once it acts
    live.until("known.run.acting.join() === 'pid' && !known.run.paused")
    t = live.get("known.plant.last")
    live.until(f"known.plant.last > {t} + 0.5")
    live.close()
    child.send(signal.SIGINT)
    assert child.wait() == 0, child.stdout + child.stderr
    run = RecordedRun.open(tmp_path / "run" / "run.mcap")
    assert run.recording.complete, run.recording.end
    verdict = verdict_on(run)
    assert verdict.exit_code == VERIFIED, verdict


def test_a_run_goes_on_without_its_gateway(children: Children, peer: Peer, tmp_path: Path) -> None:
    child, *_ = start_live(children, "demo", "--controller", "pid", "--output", "run")
    peer.until_started(child)
    os.kill(gateway_pid(child), signal.SIGKILL)
    until(lambda: "the page's server has ended" in child.stderr, "it is said")
    seen = peer.hear(f"/{topics.GROUND_TRUTH}")
    peer.until(lambda: len(seen) > 100, "the run goes on")
    child.send(signal.SIGINT)
    assert child.wait() == 0, child.stderr
    assert child.stderr.count("\n") == 1
    assert verdict_on(RecordedRun.open(tmp_path / "run" / "run.mcap")).exit_code == VERIFIED


def test_without_a_page_nobody_waits_for_the_report(
    children: Children, peer: Peer, browser: Any, tmp_path: Path
) -> None:
    child, address, _ = start_live(children, "demo", "--controller", "pid", "--output", "run")
    live = LivePage(browser, address)
    live.page.route("**/report-*.html", lambda route: route.abort())  # it stays where it is
    live.until("known.run.started && known.plant.count > 10")
    live.page.click("#stop")
    until(lambda: "waiting for the page to fetch the report" in child.stdout, "it waits")
    assert child.process.poll() is None
    with claimed_domain():  # for the next run
        pass
    live.close()
    assert child.wait() == 0, child.stdout + child.stderr
    for words in ("stopped by request: ending", "reading the recording", "making the report"):
        assert words in child.stdout
    assert (tmp_path / "run" / "report.html").exists()


def test_a_run_that_is_stopped_before_it_begins_is_said_to_be_over(
    children: Children, peer: Peer, browser: Any, tmp_path: Path
) -> None:
    held = ("--set", "pid.autostart=false")
    child, address, _ = start_live(children, "demo", "--controller", "pid", *held)
    live = LivePage(browser, address, ready=False)
    live.until("document.getElementById('mode').textContent === 'waiting for the run to start'")
    live.page.click("#stop")
    live.until("document.getElementById('link').dataset.state === 'closed'")
    why = "stopped by request before the run began"
    assert live.page.inner_text("#alarm-text") == f"the server of this page has ended: {why}"
    assert live.page.inner_text("#mode") == why
    live.close()
    assert child.wait() == 1
    assert child.stderr == f"trunk: error: {why}\n"


def test_a_running_graph_is_joined_and_keeps_running(
    children: Children, peer: Peer, browser: Any, tmp_path: Path
) -> None:
    run = children.trunk("run", "demo", "--duration", 36000, "--rate", 200, "--output", "run")
    peer.until_started(run)
    child, address, _ = start_live(children, "--attach", "/")
    live = LivePage(browser, address)
    live.until("known.run.started && known.plant.count > 10")
    assert live.page.locator("#stop").is_hidden()
    live.page.click("#reset")
    live.until("known.events.some((event) => event.event === 'reset')")
    child.send(signal.SIGINT)
    assert child.wait() == 0, child.stdout + child.stderr
    live.until("document.getElementById('link').dataset.state === 'closed'")
    live.close()
    assert run.process.poll() is None
    run.send(signal.SIGINT)
    run.wait()
    recorded = RecordedRun.open(tmp_path / "run" / "run.mcap")
    assert recorded.count(topics.GROUND_TRUTH) > 0
