"""What a lab's page shows and gives away: commands, numbers, files; looks and access; in Chromium."""

from __future__ import annotations

import shlex

import pytest

from trunk_experiments.lab.wasm import missing_tools

from .page_actions import (
    CELL,
    DESK,
    PHONE,
    copied,
    pulled,
    saved,
    seek,
    set_gain,
    whole,
)

pytestmark = [
    pytest.mark.skipif(bool(missing_tools()), reason=missing_tools()),
    pytest.mark.browser,
]


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


def test_numbers_of_all_controllers_stand_side_by_side_with_falls_first(opened, lab):
    page = opened()
    assert page.locator("#doubts li.bad").all_inner_texts() == [
        "pid FELL: at t = 1.064 s, −90 degrees",
        "fuzzy_pid FELL: at t = 1.085 s, −90 degrees",
    ]
    page.click("#tab-numbers")
    rows = page.locator("#numbers tr").evaluate_all(
        "rows => rows.map(({ cells }) => [...cells].map((cell) => cell.textContent))"
    )
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
        seek(page, 2.0)
    page.evaluate("() => edits.undo()")
    page.wait_for_function("() => !wire.setup.values.simulator")
    page.evaluate("() => edits.undo()")
    page.wait_for_function("() => isDefaultSetup(wire.setup)")
    whole(page)
    assert "DIVERGED" not in page.inner_text("#doubts")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_desk_all_is_on_one_screen(opened, scheme):
    page = opened(color_scheme=scheme)
    page.click("#branch")
    page.wait_for_selector(".chip")
    whole(page)
    assert page.evaluate("() => document.documentElement.scrollHeight <= innerHeight")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert page.locator("#live-charts .chart").count() == 5


@pytest.mark.parametrize("viewport", [PHONE, {"width": 320, "height": 640}], ids=["390", "320"])
def test_on_a_phone_nothing_is_wider_than_the_screen(opened, viewport):
    page = opened(viewport, has_touch=True)
    page.evaluate("() => document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    box = page.locator("#scene").bounding_box()
    assert box["y"] < 500, "the trunks are in sight"
    page.click("#tab-numbers")
    page.evaluate("() => edits.set('disturbance', { 'pulse.magnitude': 0 })")
    page.wait_for_selector("#numbers .star")
    page.evaluate("() => { document.querySelector('#numbers table').style.width = '800px'; }")
    page.click("#copy-commands")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


def test_reduced_motion_waits_for_a_hand(opened):
    page = opened(reduced_motion="reduce")
    assert page.evaluate("() => [view.playing, view.time]") == [False, 0]
    page.click("#play")
    page.wait_for_function("() => view.time > 0.1")


LOOKS = [(DESK, "light"), (DESK, "dark"), (PHONE, "light"), (PHONE, "dark")]


@pytest.mark.parametrize(("viewport", "scheme"), LOOKS, ids=["desk", "dark", "phone", "phone-dark"])
def test_axe_has_no_complaint(browser, path, viewport, scheme):
    pytest.importorskip(
        "axe_playwright_python", reason="axe-playwright-python: scripts/bootstrap.sh"
    )
    from axe_playwright_python.sync_playwright import Axe

    with browser.new_context(viewport=viewport, color_scheme=scheme, bypass_csp=True) as context:
        context.set_default_timeout(0)
        page = context.new_page()
        page.goto(path.as_uri())
        whole(page)
        page.evaluate(
            "() => { document.documentElement.dataset.whole = 'true'; view.freeze(true); }"
        )
        for prepare in ("#branch", "#tab-numbers", "#save-experiment", "#copy-commands"):
            page.click(prepare)
            whole(page)
            page.evaluate(  # the darkest a cell can be
                "() => document.querySelector('.rule-table td').style.setProperty('--weight', 1)"
            )
            found = Axe().run(page).response
            assert [rule["id"] for rule in found["violations"]] == [], prepare
            assert len(found["passes"]) > 15


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
    page = opened(viewport=DESK)
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


def test_paper_has_the_whole_run_on_one_page(opened):
    page = opened(color_scheme="dark")
    page.evaluate(
        """() => addEventListener("beforeprint", () => queueMicrotask(() => {
            window.printed = [...strips.made.values()].map(({ target, plot }) => ({
                room: target.clientWidth, width: plot.width, ink: plot.axes[0].stroke(),
                last: plot.data[0].at(-1), canvas: plot.ctx.canvas.clientWidth,
            }));
            const { canvas } = scene;
            window.stretched = canvas.width / canvas.clientWidth - canvas.height / canvas.clientHeight;
        }))"""
    )
    page.evaluate("() => wire.take({ ...wire.setup, pushes: [[1e9, 20, 0], [1.1e9, 0, 0]] })")
    pages = page.pdf(format="A4").count(b"/Type /Page\n")
    assert pages == 1
    for chart in page.evaluate("() => window.printed"):
        assert chart["width"] == chart["room"] == chart["canvas"] < 184 / 25.4 * 96  # mm to pixels
        assert chart["ink"] == "#000"
        assert chart["last"] == pytest.approx(3.0)
    assert abs(page.evaluate("() => window.stretched")) < 0.02
    page.wait_for_function("() => strips.made.get('angle').plot.axes[0].stroke() !== '#000'")
