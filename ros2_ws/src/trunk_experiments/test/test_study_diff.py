"""Two sweeps compared: what differs is counted and named; what cannot be compared is refused."""

from __future__ import annotations

import json
import math

import pyarrow as pa
import pyarrow.parquet as pq
import pytest


def write(path, numbers=(0, 1, 2), iae=(0.1, 0.2, None), commit="a", study="s", **more):
    """Write what looks like a sweep's results."""
    columns = {
        "run": pa.array(numbers, pa.int64()),
        "controller": ["pid"] * len(numbers),
        "status": ["ok"] * len(numbers),
        "iae": pa.array(iae, pa.float64()),
    }
    metadata = {"study": study, "grid": "[]", "provenance": json.dumps({"commit": commit})}
    table = pa.table({**columns, **more}).replace_schema_metadata(metadata)
    pq.write_table(table, path)
    return str(path)


@pytest.fixture
def diff(tmp_path, command_says):
    """Compare the plain results with others; return the exit code and the lines."""

    def run(**others):
        paths = write(tmp_path / "a.parquet"), write(tmp_path / "b", **others)
        code, out, err = command_says("diff", *paths)
        return code, (out + err).splitlines()

    return run


def test_equal_runs_are_identical_in_any_order(diff):
    assert diff() == (0, ["identical: 3 runs, bit for bit"])
    code, lines = diff(numbers=(2, 1, 0), iae=(None, 0.2, 0.1), commit="b", study="t")
    assert code == 0
    assert lines == [
        "identical: 3 runs, bit for bit",
        "  study: not the same",
        "  provenance: commit: a in A, b in B",
    ]


def test_the_first_cell_and_the_largest_distance_are_named(diff):
    near = math.nextafter(0.2, 1.0), math.nextafter(0.1, 1.0)
    far = math.nextafter(near[1], 1.0)
    assert diff(iae=(far, near[0], None)) == (
        1,
        [f"different in 2 runs; first in run 0, iae: 0.1 in A, {far!r} in B; at most 2 ULP apart"],
    )
    assert diff(iae=(0.1, 0.2, 0.3))[1] == [
        "different in 1 runs; first in run 2, iae: nothing in A, 0.3 in B"
    ]
    assert diff(iae=(0.1, 0.2, math.nan))[0] == 1


def test_runs_and_columns_of_one_alone_differ(diff):
    assert diff(numbers=(0, 1, 3))[1] == [
        "different in 2 runs; first in run 2, run: 2 in A, nothing in B"
    ]
    assert diff(mass=[1.0, 1.0, 1.0])[1] == [
        "different in 3 runs; first in run 0, mass: nothing in A, 1.0 in B"
    ]


def test_what_cannot_be_compared_is_refused_in_one_line(diff, command_says, tmp_path):
    code, [line] = diff(numbers=(0, 1, 1))
    assert code == 2
    assert line.endswith("b: a number of a run appears twice: sweep the study again")
    other = tmp_path / "run.mcap"
    other.write_bytes(b"\x89MCAP0\r\n")
    code, _, err = command_says("diff", tmp_path / "a.parquet", other)
    assert code == 2
    assert err.endswith("run.mcap: not a Parquet file: give the results of a trunk sweep\n")
