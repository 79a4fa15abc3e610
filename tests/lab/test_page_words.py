"""What a lab's page says in words: what acts, who fell, which number is best, what a saved file holds."""

import json

import pytest

from trunk_core.parameters.declarations import values_of
from trunk_evidence.run_metrics import QUANTITIES
from trunk_msgs_util.picture.frames import as_data
from trunk_msgs_util.picture.shapes import Geometry
from trunk_sim.config import TrunkSimulator

from .page_actions import saved, seek, whole

pytestmark = pytest.mark.browser
NO_PULSES = "() => edits.set('disturbance', { 'pulse.magnitude': 0 })"
# The words in the picture of the trunks.
DRAWN = """() => {
  const texts = [];
  const { prototype } = CanvasRenderingContext2D;
  const { fillText } = prototype;
  prototype.fillText = (text) => texts.push(text);
  scene.draw(view.time);
  prototype.fillText = fillText;
  return texts; }"""
BEST = """() => Object.fromEntries([...document.querySelectorAll('#numbers-rows tr')].map(({ cells }) =>
  [cells[0].textContent, [...cells].flatMap((cell, i) => (cell.querySelector('.star') ? [i - 1] : []))]))"""


def marked(page):
    """Return, by quantity, the names of the runs that the page marks as the best."""
    names = page.evaluate("() => known.runs.map(({ name }) => name)")
    return {label: [names[i] for i in best] for label, best in page.evaluate(BEST).items()}


def test_what_acts_is_said_and_marked(opened):
    page = opened(reduced_motion="reduce")
    assert page.inner_text("#acts").startswith(
        "At 1 s: +100° on the measured angle, for 0.1 s. Reference: 0°. There is no ground: "
    )
    assert page.evaluate("() => known.pulses") == [
        {"start": 1, "end": 1.1, "text": "+100° on the measured angle"}
    ]
    assert "pulse acts" in page.inner_text("#strip-angle figcaption")
    for time, acts in ((0.999, False), (1.0, True), (1.099, True), (1.1, False)):
        seek(page, time)
        assert ("+100° on the measured angle" in page.evaluate(DRAWN)) is acts, time
    for setting in (
        "'disturbance', { 'pulse.start_times': [0.5, 2], 'pulse.duration': 0.25, 'pulse.magnitude': -0.1 }",
        "'pid', { 'reference.value': 0.2 }",
    ):
        page.evaluate(f"() => edits.set({setting})")
        whole(page)
    assert page.inner_text("#acts").startswith(
        "At 0.5 s and 2 s: −5.73° on the measured angle, for 0.25 s. "
        "Reference of pid: 11.46°. Reference of fuzzy_pid: 0°."
    )
    page.evaluate("() => edits.set('fuzzy_pid', { 'reference.value': 0.2 })")
    page.evaluate(NO_PULSES)
    whole(page)
    assert page.inner_text("#acts") == "Reference: 11.46°."
    assert "pulse acts" not in page.inner_text("#strip-angle figcaption")


def test_the_picture_is_that_of_the_parameters(opened):
    page = opened()
    drawn = "() => known.world.picture"
    known = dict(values_of(TrunkSimulator()))
    for name, value in (
        ("plant.length", 0.7),
        ("path.amplitude", 0.5),
        ("path.wavenumber", 2.0),
    ):
        page.evaluate("(values) => edits.set('simulator', values)", {name: value})
        known[name] = value
        geometry = Geometry.from_parameters(known)
        assert page.evaluate(drawn) == as_data(geometry.picture), name


def test_no_part_of_a_parameter_is_zero(opened):
    page = opened()
    page.evaluate("() => { lab.picture.frames[0].at[0] = { name: 'plant.length', factor: 0 }; }")
    page.evaluate("() => edits.set('simulator', { 'plant.length': 0.7 })")
    assert page.evaluate("() => known.world.picture.frames[0].at[0]") == 0


def test_a_fall_stays_in_words_until_its_run_is_replaced(opened):
    page = opened(reduced_motion="reduce")
    seek(page, 3.0)  # long after it
    names = page.locator("#controllers label")
    assert names.all_text_contents() == ["pid fell", "fuzzy_pid fell"]
    assert {f"✕ fell at t = {time} s" for time in (1.064, 1.085)} <= set(page.evaluate(DRAWN))
    assert "There is no ground: a fallen trunk goes on" in page.inner_text("#acts")
    page.evaluate(NO_PULSES)
    whole(page)
    assert names.all_text_contents() == ["pid", "fuzzy_pid"]
    assert page.locator("#doubts").is_hidden()


def test_the_best_numbers_are_those_of_trunk_compare(opened, trunk, tmp_path):
    page = opened()
    assert not any(marked(page).values()), "who fell is not ranked"
    page.evaluate(NO_PULSES)
    whole(page)
    files = [tmp_path / f"{name}.mcap" for name in ("pid", "fuzzy_pid")]
    for file in files:
        experiment = saved(page, file.stem, tmp_path)
        assert trunk("simulate", "--like", experiment, "-o", file)[0] == 0
    code, out, err = trunk("compare", *files, "--json")
    assert code == 0, err
    ours = json.loads(out)
    runs = [run["name"] for run in ours["runs"]]
    names = dict(zip(runs, ("pid", "fuzzy_pid"), strict=True))
    expected = {
        f"{QUANTITIES[key].label}, {QUANTITIES[key].unit}": [names[name] for name in row["best"]]
        for key, row in ours["metrics"].items()
    }
    assert ours["different_tasks"] == []
    assert any(expected.values())
    best = marked(page)
    assert {label: best[label] for label in expected} == expected
    assert "best: " in page.locator("#numbers-rows td.best").first.text_content()
    page.evaluate("() => edits.set('pid', { 'reference.value': 0.2 })")
    whole(page)
    assert "NOT RANKED: the runs have different tasks: controller.reference.value" in (
        page.inner_text("#doubts")
    )
    assert not any(marked(page).values())


def test_a_saved_file_is_confirmed_with_the_next_step(opened, tmp_path):
    page = opened()
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    whole(page)
    assert page.inner_text("#saved") == ""
    path = saved(page, "pid", tmp_path)
    words = page.inner_text("#saved")
    assert page.get_attribute("#saved", "role") == "status"
    kilobytes = f"{path.stat().st_size / 1e3:.3g}"
    assert words.startswith(
        f"Saved {path.name}, {kilobytes} kB: the run of pid, with all parameters, "
    )
    assert "branch at t = 1.2 s" in words
    assert words.endswith(f"trunk simulate --like {path.name}")
    page.click(".chip")
    whole(page)
    assert page.inner_text("#saved") == "", "it was of another experiment"


def test_the_glossary_has_each_quantity_as_the_project_defines_it(opened):
    page = opened()
    page.click("#tab-numbers")
    page.click("#glossary summary")
    words = page.locator("#glossary dd").all_text_contents()
    assert words[-len(QUANTITIES) :] == [text.meaning for text in QUANTITIES.values()]
    assert page.locator("#glossary dt:has-text('α')").is_visible()
