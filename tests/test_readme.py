"""The README's generated tables say what the declarations say."""

from __future__ import annotations

from pathlib import Path

from trunk_experiments.readme import refreshed

README = Path(__file__).parents[1] / "README.md"


def test_the_tables_are_those_of_the_declarations():
    text = README.read_text(encoding="utf-8")
    assert text.count("<!-- generated: ") == 3
    assert refreshed(text) == text, "run scripts/update_readme.sh"


def test_a_stale_table_is_noticed():
    text = README.read_text(encoding="utf-8")
    stale = text.replace("Mass M of the hip", "Mass of the hip")
    assert stale != text
    assert refreshed(stale) == text
