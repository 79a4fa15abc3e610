"""`trunk live` in a headless Chromium, as a person uses it: an address, a page, a mouse."""

import re
from collections.abc import Callable
from typing import Any

from .processes import Child, Children, until

SMALL = {"width": 800, "height": 480}  # charts that are not in sight are not drawn
# What the page says goes to the test's output, where it shows why a wait never ends.
_SAID = """addEventListener("DOMContentLoaded", () => {
  const alarm = document.getElementById("alarm-text");
  const say = () => console.log([...alarm.children].map((one) => one.textContent).join("; "));
  if (alarm) new MutationObserver(say).observe(alarm, { childList: true });
});"""
_HELD = {"tip": "trunk", "hip": "hip", "ring": "reference"}


class LivePage:
    """A page of a gateway; every wait has a condition."""

    def __init__(
        self,
        browser: Any,
        address: str,
        viewport: dict[str, int] | None = None,
        ready: bool = True,
    ) -> None:
        """``ready``: wait until it shows a run."""
        self.complaints: list[str] = []
        self._context = browser.new_context(viewport=viewport or SMALL)
        self._context.set_default_timeout(0)  # pytest has one
        self.page = self._context.new_page()
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.add_init_script(_SAID)
        self.page.on("console", lambda message: print(f"the page: {message.text}"))
        self.page.on("dialog", lambda dialog: self.complaints.append("dialog"))
        self.requests: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(address)
        if ready:
            self.ready()

    def ready(self) -> None:
        """Wait until it shows a run."""
        self.page.wait_for_selector("html[data-ready]")

    def close(self) -> None:
        self._context.close()

    def get(self, expression: str) -> Any:
        """Return an expression's value in the page."""
        return self.page.evaluate(f"() => {expression}")

    def until(self, condition: str) -> None:
        """Wait until an expression is true in the page."""
        self.page.wait_for_function(f"() => {condition}", polling=50)

    def point(self, place: str) -> tuple[float, float] | None:
        """Return where something of the scene is on the screen: ``tip``, ``hip``, or the ``ring``.

        None while it is out of sight, or behind something else.
        """
        found = "scene.ring()" if place == "ring" else f"scene.places().{place}"
        # In one call, since it moves.
        x, y, seen = self.page.evaluate(
            f"""() => {{
                const box = scene.canvas.getBoundingClientRect(), at = {found};
                const [x, y] = [box.left + at[0], box.top + at[1]];
                return [x, y, document.elementFromPoint(x, y) === scene.canvas];
            }}"""
        )
        return (x, y) if seen else None

    def pull(self, place: str, right: float, up: float, while_: Callable[[], None]) -> None:
        """Hold something of the scene and drag it by this many pixels until ``while_`` returns."""
        mouse = self.page.mouse
        self.page.locator("#scene").scroll_into_view_if_needed()
        # It moves while the mouse approaches: a hand tries again. What it grabbed instead is released without
        # a tap, which would knock the trunk over, and without a click.
        x = y = 0.0
        while self.get("grip.held") != _HELD[place]:
            self.get("scene.canvas.dispatchEvent(new PointerEvent('pointercancel'))")
            mouse.move(0, 0)
            mouse.up()
            if at := self.point(place):
                x, y = at
                mouse.move(x, y)
                mouse.down()
        mouse.move(x + right, y - up)
        while_()
        mouse.up()

    def knob(self, node: str, name: str) -> Any:
        """Return the field of a parameter, its section unfolded."""
        section = self.page.locator(f"#knobs details[data-node={node}]")
        section.evaluate("details => { details.open = true; }")
        return self.page.locator(f"[id='knob-{node}-{name.replace('.', '-')}']")


def start_live(children: Children, *given: object) -> tuple[Child, str, str]:
    """Start `trunk live`; return it and the addresses that it prints, to control and to watch."""
    child = children.trunk("live", *given, "--no-browser")
    found = until(
        lambda: (
            child.process.poll() is not None
            or re.search(r"page: (\S+)\nto watch only: (\S+)\n", child.stdout)
        ),
        "the page's address",
    )
    assert child.process.poll() is None, child.stderr
    return child, found[1], found[2]
