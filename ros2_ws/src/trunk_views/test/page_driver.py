"""Pages in Chromium: opened, looked at and driven by the same code, whether live, a report or a lab."""

from pathlib import Path

import pytest

from trunk_views import run_report

DESK, PHONE = {"width": 1400, "height": 900}, {"width": 390, "height": 844}
NARROW = "() => document.documentElement.scrollWidth <= innerWidth"
FITS = "() => document.documentElement.scrollHeight <= innerHeight"
INK = "() => strips.made.get('angle').plot.axes[0].stroke()"


@pytest.fixture
def opened(new_page):
    """Return a function that opens a page; it asks for nothing but what is at its own address."""
    asked = []

    def go(place, viewport=DESK, ready="html[data-ready]", **options):
        page = new_page(viewport=viewport, **options)
        address = place.as_uri() if isinstance(place, Path) else place
        source = address.partition("#")[0]
        page.on("request", lambda request: asked.append((request.url, source)))
        page.goto(address)
        page.wait_for_selector(ready)
        return page

    yield go
    assert [url for url, source in asked if not url.startswith((source, "data:", "blob:"))] == []


def until(page, expression, value=True):
    """Wait until an expression in the page has a value."""
    page.wait_for_function(f"(value) => ({expression}) === value", arg=value)


@pytest.fixture
def without_pictures(monkeypatch):
    """Make reports without their pictures, which are most of the work."""
    monkeypatch.setattr(run_report, "_pictures", lambda views, names: ())


@pytest.fixture
def reported(opened, without_pictures, tmp_path):
    """Return a function that opens a report on runs, without pictures."""

    def go(views, *where, **options):
        run_report.write(run_report.make_report(views), tmp_path / "report.html")
        return opened(tmp_path / "report.html", *where, **options)

    return go


def across(target, x=0.5):
    """Return a place on the screen: at a part of the width of an element, which comes into sight."""
    target.scroll_into_view_if_needed()
    box = target.bounding_box()
    return box["x"] + x * box["width"], box["y"] + box["height"] / 2
