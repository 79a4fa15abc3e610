"""What tests do with a lab's page in Chromium."""

import json
import shlex

WHOLE = "html[data-ready][data-whole]"
SETUP = "() => JSON.stringify(wire.setup)"
# All bits of the runs' tables, up to a state, as a number each.
TABLES = """(states) => wire.engines.map(({ table, count, width }) => {
  const words = new Uint32Array(table.buffer, 0, 2 * width * Math.min(count, states ?? count));
  return words.reduce((sum, word) => Math.imul(sum ^ word, 16777619) >>> 0, 2166136261); })"""
THETA = "(engine) => Array.from(engine.column('theta'))"
P_MAX = "#gain-fuzzy_pid-gains-p_max"
# A click on a cell of Kp: the row and column of zero.
CELL = "#tables .rule-table:first-child tbody tr:nth-child(4) td:nth-child(5) button"


def whole(page):
    page.wait_for_selector(WHOLE)


def setup(page):
    return json.loads(page.evaluate(SETUP))


def set_gain(page, value):
    page.fill(P_MAX, str(value))
    page.press(P_MAX, "Enter")


def seek(page, time):
    page.locator("#seek").fill(str(time))
    page.wait_for_function("(time) => Math.abs(view.time - time) < 1e-9 && !view.playing", arg=time)


def pulled(page, pane=1):
    """Take the tip of a run's trunk in the hand and pull it to the right."""
    x, y = page.evaluate(
        """(pane) => {
          scene.draw(view.time); // the last picture may be of another time
          const box = scene.canvas.getBoundingClientRect();
          const { tip } = scene.panes[pane].places;
          return [box.left + tip[0], box.top + tip[1]]; }""",
        pane,
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 10, steps=4)


def copied(page):
    page.click("#copy-commands")
    page.wait_for_selector("#copying:visible")
    lines = page.inner_text("#copied").splitlines()
    return [shlex.split(line) for line in lines if not line.startswith("#")]


def saved(page, name, folder):
    """Save the experiment of a controller's run; return its path."""
    page.click(f"#controllers input[value={name}]")
    page.wait_for_selector(f"#save-experiment:enabled >> text=Save experiment of {name}")
    with page.expect_download() as download:
        page.click("#save-experiment")
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path
