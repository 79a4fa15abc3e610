"""The pages' generated tables agree with the declarations."""

from __future__ import annotations

from pathlib import Path

import pytest

from trunk_experiments.readme import refreshed

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = {"README.md": 3, "docs/recording.md": 1, "docs/api.md": 1}  # generated parts of each


@pytest.mark.parametrize(("page", "tables"), PAGES.items(), ids=PAGES)
def test_the_tables_match_the_declarations(page, tables):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert text.count("<!-- generated: ") == tables
    assert refreshed(text) == text, "run scripts/update_readme.sh"


def test_a_stale_table_is_noticed():
    text = README.read_text(encoding="utf-8")
    stale = text.replace("Mass M of the hip", "Mass of the hip")
    assert stale != text
    assert refreshed(stale) == text
