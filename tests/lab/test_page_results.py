"""What a lab's page shows and gives away: commands, numbers, files; looks and access; in Chromium."""

import shlex

import pytest
from ros2_ws.src.trunk_views.test.page_driver import NARROW, PHONE

from .page_actions import CELL, copied, pulled, saved, seek, set_gain, whole

pytestmark = pytest.mark.browser


def test_commands_are_those_of_the_experiment(opened, lab):
    page = opened()
    plain = copied(page)
    assert plain == [
        [*lab["commands"][name], "-o", f"fig8_{name}.mcap"] for name in ("pid", "fuzzy_pid")
    ]
    page.focus("#copied")
    page.keyboard.press("Escape")
    assert page.locator("#copying").is_hidden()
    assert page.evaluate("() => document.activeElement.id") == "copy-commands"
    page.evaluate(
        "() => edits.set('simulator', { 'plant.trunk_mass': 0.625, 'initial.position': [0, 0.3] })"
    )
    page.click(CELL)
    page.wait_for_selector("#tables td[data-edited]")
    whole(page)
    (pid, fuzzy) = copied(page)
    before = len(lab["commands"]["fuzzy_pid"])
    settings = [word for word in fuzzy[before:] if "=" in word]
    label = page.inner_text(CELL)
    assert settings[-1] == f"fuzzy_pid.rules.kp.ZO.ZO={label}"
    assert settings[:-1] == [
        "simulator.plant.trunk_mass=0.625",
        "simulator.initial.position=[0, 0.3]",
    ]
    assert [word for word in pid[len(lab["commands"]["pid"]) :] if "=" in word] == settings[:-1]
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    set_gain(page, 80)
    page.wait_for_function("() => wire.setup.branch.values.fuzzy_pid")
    (_, _, branch) = copied(page)
    assert branch == shlex.split(
        "trunk branch fig8_fuzzy_pid.mcap --at 1.2 --set fuzzy_pid.gains.p_max=80 "
        "-o fig8_fuzzy_pid_branch.mcap"
    )


def numbers(page):
    """Return the texts of the table of numbers, row by row."""
    return page.locator("#numbers tr").evaluate_all(
        "rows => rows.map(({ cells }) => [...cells].map((cell) => cell.textContent))"
    )


def test_numbers_of_all_controllers_stand_side_by_side_with_falls_first(opened, lab):
    page = opened()
    assert page.locator("#doubts li.bad").all_inner_texts() == [
        "pid FELL: at t = 1.064 s, −90 degrees",
        "fuzzy_pid FELL: at t = 1.085 s, −90 degrees",
    ]
    page.click("#tab-numbers")
    rows = numbers(page)
    assert rows[0] == ["quantity", "pid", "fuzzy_pid"]
    assert rows[1] == ["FELL", "at 1.064 s", "at 1.085 s"]
    assert [row[0] for row in rows[2:]] == [
        f"{label}, {unit}" for label, unit, *_ in lab["quantities"].values()
    ]
    assert all(len(row) == 3 for row in rows)
    # Rules and gains are those of the controller that is shown; the other's curve stays.
    assert page.locator("#rules").is_visible()
    page.click("#controllers input[value=pid]")
    page.wait_for_selector("#rules", state="hidden")
    page.click("#tab-parameters")
    assert page.inner_text("#gains-of") == "Gains of pid"
    page.wait_for_function(
        "() => document.getElementById('strip-angle').textContent.includes('fuzzy_pid')"
    )
    assert page.inner_text("#save-experiment") == "Save experiment of pid"


def test_a_run_that_diverges_says_so(opened):
    page = opened()
    for node, name, value in (("pid", "gains.d", 1000), ("simulator", "plant.length", 1e-6)):
        page.evaluate(f"() => edits.set('{node}', {{ '{name}': {value} }})")
        page.wait_for_function("() => wire.engines[0].ended === 'diverged'")
        whole(page)
        assert page.inner_text("#doubts").startswith("pid DIVERGED: at t = "), name
        for tab in ("#tab-numbers", "#tab-parameters"):
            page.click(tab)
            assert "NaN" not in page.inner_text("body")
        _, said, _, *rows = numbers(page)
        assert said[0] == "INCOMPLETE"
        assert said[1].startswith("diverged at ")
        assert said[2] == "no" or node == "simulator"
        assert {row[1] for row in rows} == {"–"}
        seek(page, 2.0)
    page.evaluate("() => edits.undo()")
    page.wait_for_function("() => !wire.setup.values.simulator")
    page.evaluate("() => edits.undo()")
    page.wait_for_function("() => isDefaultSetup(wire.setup)")
    whole(page)
    assert "DIVERGED" not in page.inner_text("#doubts")


def test_on_a_phone_nothing_is_wider_than_the_screen(opened):
    page = opened(PHONE, has_touch=True)
    for viewport in ({"width": 320, "height": 640}, PHONE):
        page.set_viewport_size(viewport)
        assert page.locator("#scene").bounding_box()["y"] < 500, "the trunks are in sight"
    page.click("#tab-numbers")
    page.evaluate("() => edits.set('disturbance', { 'pulse.magnitude': 0 })")
    page.wait_for_selector("#numbers .star")
    page.evaluate("() => { document.querySelector('#numbers table').style.width = '800px'; }")
    page.click("#copy-commands")
    for width in (390, 320):
        page.set_viewport_size({"width": width, "height": 640})
        assert page.evaluate(NARROW), width


def run(trunk, words):
    """Run words that begin with "trunk"; return what it prints."""
    assert words[0] == "trunk"
    code, out, err = trunk(*words[1:])
    assert code == 0, (words, out, err)
    return out


def recorded(trunk, experiment):
    """Record a saved experiment, which has the page's bits; return the recording, which verifies."""
    path = experiment.with_name(f"{experiment.stem}_like.mcap")
    said = run(trunk, ["trunk", "simulate", "--like", experiment, "-o", path, "--force"])
    assert said.endswith(": the same bits as in the browser\n")
    assert "verified" in run(trunk, ["trunk", "verify", path])
    return path


@pytest.mark.one_in(4)
def test_saved_runs_are_verified_and_those_of_the_commands(opened, trunk, tmp_path, monkeypatch):
    page = opened()
    set_gain(page, 75)
    page.click(CELL)
    page.wait_for_selector("#tables td[data-edited]")
    page.evaluate("() => edits.set('simulator', { 'plant.trunk_mass': 0.625 })")
    whole(page)
    (tmp_path / "page").mkdir()
    monkeypatch.chdir(tmp_path)
    commands = copied(page)
    for name, words in zip(("pid", "fuzzy_pid"), commands, strict=True):
        mine = recorded(trunk, saved(page, name, tmp_path / "page"))
        run(trunk, words)
        assert "identical" in run(trunk, ["trunk", "diff", mine, tmp_path / words[-1]])
    # A branch, from the command's run.
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    set_gain(page, 80)
    page.wait_for_function("() => wire.setup.branch.values.fuzzy_pid")
    whole(page)
    branch = copied(page)[-1]
    mine = recorded(trunk, saved(page, "fuzzy_pid", tmp_path / "page"))
    run(trunk, branch)
    assert "identical" in run(trunk, ["trunk", "diff", mine, tmp_path / branch[-1]])


def test_a_disturbance_that_begins_with_a_branch_is_the_commands(
    opened, trunk, tmp_path, monkeypatch
):
    page = opened()
    page.evaluate(
        "() => edits.set('disturbance', { 'pulse.magnitude': 0, 'pulse.start_times': [1.5, 5] })"
    )
    whole(page)
    seek(page, 1.2)
    page.click("#branch")
    page.wait_for_selector(".chip")
    page.evaluate("() => edits.set('disturbance', { 'pulse.magnitude': 0.5 })")
    whole(page)
    (tmp_path / "page").mkdir()
    monkeypatch.chdir(tmp_path)
    simulate, branch = copied(page)[-2:]
    mine = recorded(trunk, saved(page, "fuzzy_pid", tmp_path / "page"))
    run(trunk, simulate)
    run(trunk, branch)
    assert "identical" in run(trunk, ["trunk", "diff", mine, tmp_path / branch[-1]])


def test_a_run_pushed_by_hand_is_saved_with_the_pushes(opened, trunk, tmp_path, monkeypatch):
    page = opened()
    seek(page, 0.2)
    pulled(page)
    page.wait_for_function("() => wire.setup.pushes.length > 2 && view.time > 0.4")
    page.mouse.up()
    whole(page)
    monkeypatch.chdir(tmp_path)
    again = copied(page)[-1]
    mine = recorded(trunk, saved(page, "fuzzy_pid", tmp_path))
    assert "operator/push" in run(trunk, ["trunk", "info", mine])
    run(trunk, again)
    assert "identical" in run(trunk, ["trunk", "diff", mine, again[-1]])


NUMBERS = """() => [...strips.made.values()].map(({ kind, plot, title }) =>
  [kind.id, title.textContent, ...plot.axes.map(({ _values }) => _values.filter(Boolean).length)])"""


def test_each_axis_has_two_numbers_whatever_spikes(opened):
    page = opened()
    page.wait_for_function(
        "() => [...strips.made.values()].every(({ plot }) => plot.data[0].length)"
    )
    found = {name: (title, x, y) for name, title, x, y in page.evaluate(NUMBERS)}
    assert set(found) == {"angle", "torque", "terms", "gains", "alpha"}
    assert all(x >= 2 and y >= 2 for _, x, y in found.values()), found
    assert found["torque"][0] == "Torque, N·m (peaks cut)"
    high = page.evaluate("() => strips.made.get('torque').plot.scales.y.max")
    torque = "() => Math.max(...known.plant.columns.get('torque').subarray(0, known.plant.count))"
    assert high < 1000 < page.evaluate(torque)


def test_scripts_styles_and_html_are_small(path, data):
    assert path.stat().st_size - len(data) < 250_000
    assert path.stat().st_size < 400_000


def test_states_are_saved_as_csv_for_those_who_have_only_a_browser(opened, tmp_path):
    page = opened()
    whole(page)
    page.click("#tab-numbers")
    with page.expect_download() as download:
        page.click("#save-csv")
    assert download.value.suggested_filename == "fig8_fuzzy_pid.csv"
    download.value.save_as(tmp_path / "states.csv")
    heads, *rows = (tmp_path / "states.csv").read_text().splitlines()
    assert heads.startswith("t,x,theta,x_dot,theta_dot,")
    assert len(rows) == 3001
    assert rows[-1].startswith("3,")
    assert "all 3001 states of the run of fuzzy_pid" in page.inner_text("#saved")
