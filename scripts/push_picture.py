"""Film a push in the live page, and photograph the page: push_picture.py BROWSER FILE.gif PAGE.png.

A real run, a real page: the trunk is pulled to one side and let go, then to the other.
"""

from __future__ import annotations

import base64
import io
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

_EVERY_MS = 80
_SECONDS = 7.0
_COLOURS = 48
# In lock-step: no machine is too busy for it.
_RUN = ("demo", "--controller", "fuzzy_pid", "--controller", "pid", "--lockstep")
# When the mouse does what, in s, and where to, in pixels from the tip.
_SCRIPT = (
    (0.5, "down", 0),
    (0.6, "move", 110),
    (2.4, "up", 0),
    (3.9, "down", 0),
    (4.0, "move", -120),
    (5.6, "up", 0),
)

_CAPTURE = """(every) => {
    window.taken = [];
    window.taking = setInterval(() => window.taken.push(scene.canvas.toDataURL()), every);
}"""


def _film(page: Page) -> list[Image.Image]:
    """Pull the trunk as in `_SCRIPT` and return the pictures of it."""
    page.wait_for_function(
        "() => known.run.started && known.plant.last > 9"
    )  # its own pulses are over
    page.evaluate(_CAPTURE, _EVERY_MS)
    now = 0.0
    for at, what, right in _SCRIPT:
        page.wait_for_timeout(1000 * (at - now))
        now = at
        x, y = page.evaluate("() => scene.places().tip")
        box = page.locator("#scene").bounding_box()
        assert box is not None
        if what != "up":
            page.mouse.move(box["x"] + x + right, box["y"] + y)
        if what == "down":
            page.mouse.down()
        if what == "up":
            page.mouse.up()
    page.wait_for_timeout(1000 * (_SECONDS - now))
    page.evaluate("() => clearInterval(window.taking)")
    return [
        Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))).convert("RGBA")
        for url in page.evaluate("() => window.taken")
    ]


def _save(pictures: list[Image.Image], path: Path) -> None:
    frames = []
    for picture in pictures:
        white = Image.new("RGBA", picture.size, "white")
        flat = Image.alpha_composite(white, picture).convert("RGB")
        frames.append(flat.quantize(_COLOURS, dither=Image.Dither.NONE))
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=_EVERY_MS, loop=0, optimize=True
    )


def main() -> None:
    """Run, film, save."""
    browser, output, whole = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        live = subprocess.Popen(
            ["trunk", "live", *_RUN, "--no-browser", "--output", f"{folder}/run"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert live.stdout is not None
        found = re.fullmatch(r"page: (\S+)\n", live.stdout.readline())
        assert found is not None
        chromium = driver.chromium.launch(
            executable_path=browser, args=["--no-sandbox", "--disable-gpu"]
        )
        page = chromium.new_page(viewport={"width": 800, "height": 700})
        page.goto(found[1])
        page.wait_for_selector("html[data-ready]")
        pictures = _film(page)
        page.set_viewport_size({"width": 1400, "height": 900})
        page.wait_for_timeout(1000)
        page.screenshot(path=whole)
        chromium.close()
        live.send_signal(signal.SIGINT)
        live.communicate()
    _save(pictures, output)


if __name__ == "__main__":
    main()
