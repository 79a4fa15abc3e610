"""Pushes by hand in a lab, however short; and a number that is not there."""

import pytest

pytestmark = pytest.mark.browser

PUSHES = "() => wire.setup.pushes"
WHOLE = "html[data-whole=true]"
PLAY = "() => { view.seek(0.5); view.freeze(false); }"


def test_a_key_that_is_tapped_is_a_push_of_fifty_milliseconds_at_least(opened):
    page = opened()
    page.focus("#scene")
    page.evaluate(PLAY)
    page.keyboard.press("ArrowRight")
    page.wait_for_function("() => wire.setup.pushes.some(([, , torque]) => !torque)")
    pushes = page.evaluate(PUSHES)
    assert [torque for _, _, torque in pushes[:1]] == [12.0]
    assert pushes[-1][2] == 0.0
    assert pushes[-1][0] - pushes[0][0] >= 50_000_000
    page.wait_for_selector(WHOLE)
    page.wait_for_selector("text=1 push by hand")


def test_a_push_ends_with_the_pause_and_the_run_is_computed_to_its_end(opened):
    page = opened()
    page.focus("#scene")
    page.evaluate(PLAY)
    page.keyboard.down("ArrowRight")
    page.wait_for_function("() => wire.setup.pushes.length > 0")
    page.evaluate("() => view.freeze(true)")
    page.wait_for_selector(WHOLE)
    page.keyboard.up("ArrowRight")
    pushes = page.evaluate(PUSHES)
    assert pushes[-1][1:] == [0.0, 0.0]
    stamps = [stamp for stamp, _, _ in pushes]
    assert stamps == sorted(set(stamps))
    assert page.evaluate("() => wire.engines.every((engine) => engine.count === lab.states)")


def test_an_empty_number_is_refused(opened):
    page = opened()
    field = "#gain-fuzzy_pid-gains-p_max"
    page.fill(field, "")
    page.keyboard.press("Tab")
    page.wait_for_selector("text=a number is needed")
    assert page.input_value(field) == "60"
    assert page.evaluate("() => wire.setup.values") == {}
