"""Numbers over time from CSV: read to the bit in SI units, every mistake one line with its place."""

import math
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.parameters.csv_files import MAX_BYTES, Column, read_csv
from trunk_core.parameters.declarations import Declaration
from trunk_core.parameters.parameter_files import ParameterFileError


def array(name, minimum, maximum):
    return Declaration(
        name, (), "double array", "", "", minimum=minimum, maximum=maximum, longest=4
    )


COLUMNS = (
    Column("t", array("times", 0.0, 1e6), "s"),
    Column("reference", array("values", -1e3, 1e3), "rad"),
)
HEADER = "t [s],reference [deg]\n"
WANTED = "a header t [s],reference [rad] is needed, then a row of numbers for each time"
FINITE = "a finite number is needed; its unit belongs in the header: "


@pytest.fixture
def read(tmp_path):
    def from_text(content: str | bytes):
        file = tmp_path / "mine.csv"
        file.write_bytes(content.encode() if isinstance(content, str) else content)
        return read_csv(file, COLUMNS)

    return from_text


@pytest.mark.parametrize(
    ("text", "times", "values"),
    [
        ("t,reference\n0,1\n2.5,-0.5\n", (0.0, 2.5), (1.0, -0.5)),
        ("t [s],reference [rad]\n0,1\n", (0.0,), (1.0,)),
        ("t [ms], reference [deg]\n100,45\n100,-9\n", (0.1, 0.1), (math.radians(45), math.radians(-9))),
        (" t[min] ,reference [mrad]\r\n1e0,.5\r\n", (60.0,), (0.0005,)),
        ("\ufefft,reference\n\n3,+4.\n\n", (3.0,), (4.0,)),
        ('"t","reference"\n"1","2"\n', (1.0,), (2.0,)),
    ],
    ids=["plain", "SI", "units", "spaces", "BOM and blank lines", "quotes"],
)  # fmt: skip
def test_numbers_are_read_in_si_units(read, text, times, values):
    found = read(text)
    assert found.columns == (times, values)
    assert found.with_unit == ("[" in text,) * 2


@given(number=st.floats(0.0, 1e3))
def test_a_number_without_a_unit_is_that_double(tmp_path_factory, number):
    file = tmp_path_factory.getbasetemp() / "one.csv"
    file.write_text(f"t,reference\n{number!r},{-number!r}\n")
    assert read_csv(file, COLUMNS).columns == ((number,), (-number,))


BAD = {
    "": f"it has no numbers: {WANTED}",
    HEADER: f"it has no numbers: {WANTED}",
    "0,1\n": f"line 1: '0,1' is not allowed: {WANTED}",
    "\n\nreference,t\n0,1\n": f"line 3: 'reference,t' is not allowed: {WANTED}",
    "t;reference\n0;1\n": f"line 1: 't;reference' is not allowed: {WANTED}",
    "t,reference,note\n": f"line 1: 't,reference,note' is not allowed: {WANTED}",
    "t [s,reference\n": f"line 1: 't [s,reference' is not allowed: {WANTED}",
    "t [kg],reference\n": (
        "line 1: t: the unit 'kg' is not allowed: it is a mass; a time in s is needed, such as 5 s or 5 ms"
    ),
    "t [],reference\n": (
        "line 1: t: the unit '' is not allowed: it is a ratio; a time in s is needed, such as 5 s or 5 ms"
    ),
    "t,reference [degree]\n": (
        "line 1: reference: the unit 'degree' is not allowed: there is no unit 'degree'; "
        "an angle in rad is needed, such as 5 rad or 5 deg"
    ),
    HEADER + "0\n": "line 2: '0' is not allowed: 2 values are needed, t and reference",
    HEADER + "0,1,2\n": "line 2: '0,1,2' is not allowed: 2 values are needed, t and reference",
    HEADER + "0,\n": f"line 2: reference: '' is not allowed: {FINITE}reference [rad]",
    HEADER + "0,one\n": f"line 2: reference: 'one' is not allowed: {FINITE}reference [rad]",
    HEADER + "0,45 deg\n": f"line 2: reference: '45 deg' is not allowed: {FINITE}reference [rad]",
    HEADER + "0,nan\n": f"line 2: reference: 'nan' is not allowed: {FINITE}reference [rad]",
    HEADER + "inf,0\n": f"line 2: t: 'inf' is not allowed: {FINITE}t [s]",
    HEADER + "1_0,0\n": f"line 2: t: '1_0' is not allowed: {FINITE}t [s]",
    HEADER + "١,0\n": f"line 2: t: '١' is not allowed: {FINITE}t [s]",
    HEADER + "-1,0\n": "line 2: t: '-1' is not allowed: double, >= 0 and <= 1e+06, in s",
    "t,reference\n0,1e999\n": (
        "line 2: reference: '1e999' is not allowed: finite double, >= -1000 and <= 1000, in rad"
    ),
    HEADER + "0,1e6\n": (
        "line 2: reference: '1e6' is not allowed: double, >= -1000 and <= 1000, in rad"
    ),
    HEADER + "0,1e999\n": (
        "line 2: reference: '1e999' is not allowed: it is beyond what a double can hold; "
        "an angle in rad is needed, such as 5 rad or 5 deg"
    ),
    HEADER + "0,0\n\n2,0\n1.5,0\n": (
        "line 5: t: '1.5' is not allowed: times must ascend, and this one is before the time in the row above"
    ),
    HEADER + "0,0\n1,0\n2,0\n3,0\n4,0\n": "line 6: one row too many: at most 4 are allowed",
    HEADER + f"0,{'9' * 200}\n": (
        f"line 2: reference: '{'9' * 37}...' is not allowed: it has 204 characters: at most 100 are read; "
        "an angle in rad is needed, such as 5 rad or 5 deg"
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", BAD, ids=lambda text: repr(text[-20:]))
def test_a_mistake_gives_one_line_with_file_line_value_and_what_is_allowed(read, tmp_path, text):
    with pytest.raises(ParameterFileError) as caught:
        read(text)
    assert str(caught.value) == f"{tmp_path / 'mine.csv'}: {BAD[text]}"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (HEADER + '0,"1\n2,3\n', "not CSV: "),
        (HEADER.encode() + b"0,\x00\n", ""),
        (b"t,reference\n\xff,0\n", "not a text in UTF-8: save it as CSV UTF-8"),
        (b"t,reference\n" + b" " * MAX_BYTES, "larger than 4 MiB: give a smaller file"),
        ("t,reference\n" + "1" * 200_000 + ",0\n", "not CSV: field larger than field limit"),
    ],
    ids=["open quote", "NUL", "no text", "huge", "long cell"],
)
def test_what_is_not_csv_gives_one_line_too(read, content, told):
    with pytest.raises(ParameterFileError) as caught:
        read(content)
    assert told in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_what_is_not_a_file_is_refused_without_waiting(tmp_path):
    for path in (tmp_path, tmp_path / "none.csv", tmp_path / ("x" * 300), tmp_path / "a\0b"):
        with pytest.raises(ParameterFileError, match=r"no such file|cannot be read"):
            read_csv(path, COLUMNS)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ParameterFileError, match="no such file"):
        read_csv(tmp_path / "pipe", COLUMNS)
