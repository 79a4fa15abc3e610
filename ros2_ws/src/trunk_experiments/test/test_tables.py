"""Tables: no word is broken, whatever the terminal; one line for each row where there is none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_experiments.console import tables

words = st.text("abc_./é漢", min_size=1, max_size=30)
texts = st.lists(words, max_size=4).map(" ".join)


def printed(width, header, rows, **options):
    lines = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "screen_width", lambda: width)
        patch.setattr(tables, "print_title", lambda title: None)
        patch.setattr(tables.click, "echo", lambda text="": lines.append(text))
        tables.print_table("", header, rows, **options)
    return lines


@given(
    st.integers(20, 120),
    st.lists(st.tuples(words, texts, texts, texts), min_size=1, max_size=5),
    st.booleans(),
)
def test_no_word_is_broken(width, rows, sentences):
    lines = printed(width, ("name", "a", "b", "c"), rows, sentences=sentences)
    found = {word for line in lines for word in line.split()}
    assert {word for row in rows for cell in row for word in cell.split()} <= found


@given(st.lists(st.tuples(words, texts, texts), min_size=1, max_size=5))
def test_without_a_terminal_a_row_is_a_line(rows):
    lines = printed(tables._ENDLESS, ("name", "a", "b"), rows)
    assert [line.split() for line in lines[2:-1]] == [" ".join(row).split() for row in rows]


def test_columns_that_do_not_fit_follow_with_the_first():
    rows = [("run1.mcap", "1" * 12, "2" * 12, "3" * 12)]
    lines = printed(40, ("run", "a", "b", "c"), rows)
    assert max(map(len, lines)) <= 40
    assert [line.split() for line in lines if "run1" in line] == [
        ["run1.mcap", "1" * 12, "2" * 12],
        ["run1.mcap", "3" * 12],
    ]


def test_markdown_keeps_its_columns_whatever_a_cell_holds():
    table = tables.markdown_table(("a", "b"), [("|e|", "  x"), ("", "y")])
    assert table.splitlines() == ["| a | b |", "| --- | --- |", r"| \|e\| | x |", "|  | y |"]


def test_csv_has_all_digits_and_nothing_for_none():
    assert tables.csv_table(("a", "b"), [(0.1 + 0.2, None), ('"', "x")]) == (
        'a,b\n0.30000000000000004,\n"""",x\n'
    )


def test_rows_are_aligned_with_texts_on_the_left():
    rows = [("漢", "bb", "3"), ("aaa", "b", "1234")]
    assert tables.aligned(rows, texts=2) == ["漢   bb     3", "aaa  b   1234"]
    assert tables.aligned(rows) == ["漢   bb  3", "aaa  b   1234"]
