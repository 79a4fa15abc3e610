"""The printed tables, their symmetries, and errors that name the cell."""

import pytest

from trunk_control import rule_tables
from trunk_control.fuzzy_pid import FuzzyPidConfig
from trunk_control.rule_tables import (
    FRACTION,
    INPUT_LABELS,
    MACVICAR_WHELAN,
    POSITIVE,
    UNIT,
    Axes,
    axes_of,
    cell_changes,
    centers,
    check_labels,
    input_labels,
    is_table,
)
from trunk_core.parameters.declarations import build, with_cells

TABLES = {
    "kp": rule_tables.KP_AS_PRINTED,
    "kd": rule_tables.KD_AS_PRINTED,
    "alpha": rule_tables.ALPHA_AS_PRINTED,
}
CELLS = [(row, column) for row in range(7) for column in range(7)]


def labels(name: str) -> list[list[str]]:
    return [row.split() for row in TABLES[name]]


def asymmetric(name: str) -> set[tuple[str, str]]:
    """Cells that differ both from their mirror in e and from their mirror in e_dot."""
    table = labels(name)
    return {
        (INPUT_LABELS[row], INPUT_LABELS[column])
        for row, column in CELLS
        if table[row][column] not in (table[6 - row][column], table[row][6 - column])
    }


@pytest.mark.parametrize(
    ("name", "cells"), [("kp", set()), ("kd", {("NM", "PB")}), ("alpha", set())]
)
def test_only_table_3_has_a_cell_that_breaks_both_symmetries(name, cells):
    assert asymmetric(name) == cells


@pytest.mark.parametrize("name", TABLES)
def test_all_other_cells_are_symmetric(name):
    table = labels(name)
    if name == "kd":
        assert table[1][6] == "S"
        table[1][6] = "B"
    assert table == table[::-1]
    assert table == [row[::-1] for row in table]


@pytest.mark.parametrize(
    ("name", "e", "e_dot", "label"),
    [
        ("kp", "NB", "ZO", "B"),
        ("kp", "ZO", "ZO", "B"),
        ("kp", "ZO", "PS", "S"),
        ("kp", "NM", "NM", "S"),
        ("kd", "NB", "ZO", "S"),
        ("kd", "NM", "NS", "S"),
        ("kd", "NS", "NS", "B"),
        ("kd", "ZO", "ZO", "B"),
        ("alpha", "ZO", "NB", "B"),
        ("alpha", "NS", "NB", "M"),
        ("alpha", "ZO", "ZO", "MS"),
        ("alpha", "PM", "PS", "S"),
    ],
)
def test_cells_as_the_paper_prints_them(name, e, e_dot, label):
    assert labels(name)[INPUT_LABELS.index(e)][INPUT_LABELS.index(e_dot)] == label


def test_centers_run_along_the_rows():
    rows = ["a b b b b b c"] + ["b b b b b b b"] * 5 + ["d b b b b b e"]
    table = centers(rows, {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0, "e": 5.0}, Axes(), UNIT)
    assert (table[0], table[6], table[42], table[48]) == (1.0, 3.0, 4.0, 5.0)
    assert len(table) == 49


def test_cell_name():
    assert Axes().cell_name(1, 6) == "(e NM, e_dot PB)"


def test_numbers_stand_beside_labels_in_a_table_of_any_shape():
    axes = Axes(("low", "high"), ("R1", "R2", "R3"))
    assert centers(("S 0.25 B", "1 5e-1 B"), {"S": 0.0, "B": 0.9}, axes, UNIT) == (
        *(0.0, 0.25, 0.9),
        *(1.0, 0.5, 0.9),
    )
    with pytest.raises(ValueError, match=r"^2 rows, one per label of e; there are 3$"):
        centers(("S S S",) * 3, {"S": 0.0}, axes, UNIT)


@pytest.mark.parametrize(("count", "ends"), [(2, "E1 E2"), (3, "N P"), (5, "NB PB"), (7, "NB PB")])
def test_the_usual_labels_of_an_input(count, ends):
    labels = input_labels((), count, "E")
    assert len(labels) == count
    assert f"{labels[0]} {labels[-1]}" == ends
    check_labels(labels)


@pytest.mark.parametrize("label", ["", "a b", "1", "-1", "inf", "no", "a.b", "a=b", "x" * 33, "A"])
def test_a_label_that_would_be_taken_for_something_else_is_refused(label):
    with pytest.raises(ValueError, match=r"each label once|each label one word"):
        check_labels(["A", label])


def test_the_antidiagonal_table():
    assert MACVICAR_WHELAN == (
        "NB NB NB NB NM NS ZO",
        "NB NB NB NM NS ZO PS",
        "NB NB NM NS ZO PS PM",
        "NB NM NS ZO PS PM PB",
        "NM NS ZO PS PM PB PB",
        "NS ZO PS PM PB PB PB",
        "ZO PS PM PB PB PB PB",
    )


@pytest.mark.parametrize(
    ("numbers", "least", "below", "most", "beyond"),
    [
        (UNIT, 0.0, -5e-324, 1.0, 1.0 + 2**-52),
        (FRACTION, -1.0, -1.0 - 2**-52, 1.0, 1.0 + 2**-52),
        (POSITIVE, 5e-324, 0.0, 1e6, 1e6 + 2**-33),
    ],
    ids=["unit", "fraction", "positive"],
)
def test_ranges_include_their_ends(numbers, least, below, most, beyond):
    assert [numbers.holds(x) for x in (least, most)] == [True, True]
    assert [numbers.holds(x) for x in (below, beyond, float("nan"))] == [False] * 3


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (("A B", "C D"), True),
        (["A B C", "C D E", "1 2 3"], True),
        (("A B",), False),
        (("A", "B"), False),
        (("A B", "C D E"), False),
        (("A B", 3), False),
        ("AB", False),
        (4, False),
    ],
)
def test_what_is_a_table(value, expected):
    assert is_table(value) is expected


def test_labels_that_do_not_fit_give_way_to_the_usual_ones():
    given = {"fuzzy.error_labels": ["low", "high"], "fuzzy.rate_labels": ["a", "b"]}
    assert axes_of(("A B C", "A B C"), given) == Axes(("low", "high"), ("N", "ZO", "P"))
    strange = {"fuzzy.error_labels": 3, "fuzzy.rate_labels": "ab"}  # of a file that is not ours
    assert axes_of(("A B", "A B"), strange) == axes_of(("A B", "A B"), {})
    assert axes_of(("A B", "A B"), {}) == Axes(("E1", "E2"), ("R1", "R2"))


def test_changes_are_named_cell_by_cell():
    assert cell_changes(("A B", "C D"), ("A X", "C D")) == ((0, 1, "B", "X"),)
    for other in (("A B",), ("A", "C")):
        with pytest.raises(ValueError, match="zip"):
            cell_changes(("A B", "C D"), other)


def test_labels_that_are_given_are_checked():
    with pytest.raises(ValueError, match="each label once; N is there twice"):
        input_labels(("N", "N"), 2, "E")
    assert rule_tables.STANDARD_LABELS[9][::4] == ("NVB", "ZO", "PVB")
    assert (rule_tables.GAIN_LABELS, rule_tables.GAIN_CENTERS) == (("S", "B"), (0.0, 1.0))


ONE_LABEL = {"rules.kp": ("S S S",) * 3, "rules.kd": ("S S S",) * 3, "rules.alpha": ("S S S",) * 3}
THREE = {"fuzzy.error_peaks": (-1.0, 0.0, 1.0), "fuzzy.rate_peaks": (-1.0, 0.0, 1.0), **ONE_LABEL}


def test_one_label_with_one_center_is_a_base():
    single = {"fuzzy.kp_labels": ("S",), "fuzzy.kp_centers": (0.5,)}
    config = build(FuzzyPidConfig, {**THREE, **single})
    assert config.tables[0].centers == {"S": 0.5}
    assert config.axes.error == ("N", "ZO", "P")  # nobody gave any


def test_one_cell_is_a_parameter_of_its_table():
    config = build(FuzzyPidConfig, with_cells(FuzzyPidConfig, {"rules.kp.ZO.ZO": "S"}))
    kp, _, alpha = config.tables
    assert kp.cells[3] == ("S", "S", "S", "S", "S", "S", "S")
    assert (kp.symbol, kp.title) == ("Kp'", "Kp′")
    assert (alpha.symbol, alpha.title) == ("alpha", "α")
