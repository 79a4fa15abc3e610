"""Plants as pages draw them: where Python says, and where a hand feels them."""

import pytest

from trunk_msgs_util.picture.frames import as_data
from trunk_views.parts.page import part

from ...trunk_sim.test.geometries import ARMS, cart_pole, trunk
from .graph_double import ServedGraph

pytestmark = pytest.mark.browser

GEOMETRIES = {
    "trunk": trunk(path_cosines=[0.05], path_sines=[0.0, 0.1]),
    "cart-pole": cart_pole(),
    "two arms": cart_pole(ARMS),
}
POINTS = """([picture, position]) => picture.visuals.map(({ frame, points }) =>
  points.map((point) => spotIn(placed(picture, position)[frame], point)))"""
# Where things are, and how many arcs are drawn: discs, and a torque's.
PAINTED = """([picture, drive]) => {
  const context = document.createElement("canvas").getContext("2d");
  let arcs = 0;
  context.arc = () => { arcs += 1; };
  const view = { left: -2, right: 2, low: -1, high: 1, color: "red", fullTorque: 40 };
  const scene = { ...view, picture, drive, reach: reachOf(picture) };
  const now = { x: 0.5, theta: 30, measured: 20, reference: 10, torque: 9, pulse: null, fell: null };
  return { ...paintStage(context, { width: 400, tall: 200 }, scene, now), arcs }; }"""


@pytest.fixture
def page(new_page):
    """Return a page with the scripts that draw."""
    page = new_page()
    page.set_content(f"<script>{part('numbers.js')}{part('stage.js')}</script>")
    return page


@pytest.mark.parametrize("name", GEOMETRIES)
def test_pages_place_a_picture_as_films_do(page, name):
    geometry = GEOMETRIES[name]
    picture = as_data(geometry.picture)
    reach = page.evaluate("(picture) => reachOf(picture)", picture)
    assert reach == pytest.approx(geometry.reach, rel=1e-15)
    for position in ((0.0, 0.0), (0.7, -0.4), (-3.1, 2.0)):
        drawn = page.evaluate(POINTS, [picture, position])
        for points, visual in zip(drawn, geometry.picture.visuals, strict=True):
            expected = [(x, z) for x, _, z in geometry.points(visual, *position)]
            assert points == [pytest.approx(spot, abs=1e-14) for spot in expected], visual.name


@pytest.mark.parametrize(("name", "arcs"), [("trunk", 3), ("cart-pole", 1), ("two arms", 2)])
def test_a_torque_is_an_arc_and_a_force_an_arrow(page, name, arcs):
    geometry = GEOMETRIES[name]
    painted = page.evaluate(PAINTED, [as_data(geometry.picture), geometry.drive])
    assert painted["arcs"] == arcs
    x, _, z = geometry.points(geometry.held, 0.5, 0.5235987755982988)[-1]
    assert painted["tip"] == pytest.approx([200 + 100 * x, 100 - 100 * z])
    assert painted["sense"] == geometry.picture.frames[1].sense


@pytest.fixture
def served():
    served = ServedGraph()
    yield served
    served.close()


def test_a_hand_pulls_a_pole_to_where_it_points(opened, served):
    page = opened(served.address)
    page.wait_for_selector(".rule-dot")
    picture = as_data(cart_pole().picture)
    page.evaluate(
        """(picture) => {
            Object.assign(known.world, { picture, drive: 0 });
            scene.draw(view.time);
            window.asked = [];
            wire.send = (kind, values) => asked.push([kind, values]);
        }""",
        picture,
    )
    box = page.locator("#scene").bounding_box()
    for place, kind, name in (("places().tip", "push", "torque"), ("ring()", "reference", "angle")):
        page.evaluate("() => { asked.length = 0; }")
        x, y = page.evaluate(f"() => {{ scene.draw(view.time); return scene.{place}; }}")
        page.mouse.move(box["x"] + x, box["y"] + y)
        page.mouse.down()
        page.mouse.move(box["x"] + x + 80, box["y"] + y + 10)
        last = f"asked.findLast(([kind]) => kind === '{kind}')?.[1].{name}"
        page.wait_for_function(f"() => {last} < -0.1")  # to the right is back
        page.mouse.up()
