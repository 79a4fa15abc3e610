"""The keys that name a reference's CSV file; only plans read these keys."""

from __future__ import annotations

from trunk_msgs_util.parameters.declarations import Declaration
from trunk_msgs_util.parameters.table_keys import TableFile

REFERENCE_FILE = TableFile(
    Declaration(
        "reference.file",
        "",
        "string",
        "",
        "CSV with the columns t and reference, for the profile file; a plan holds the numbers",
    ),
    "reference.times",
    "reference.values",
    "reference",
    "reference.profile",
    Declaration(
        "reference.interpolation",
        "linear",
        "string",
        "",
        "Between two of its rows: a straight line, or the earlier row's value",
        choices=("linear", "hold"),
    ),
    (("linear", "interpolated"), ("hold", "sequence")),
)
