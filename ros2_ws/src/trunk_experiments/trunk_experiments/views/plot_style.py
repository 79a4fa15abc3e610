"""How every plot looks: colours, dashes, fonts, and reproducible files."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from trunk_msgs_util.files import atomic_write

from ..errors import PlanError

# Okabe and Ito's colours without the yellow, distinct with any colour vision, and a violet; line styles that
# survive grey print.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#5E4FA2")
DASHES: tuple[Any, ...] = (
    "solid",
    (0, (6, 1.6)),
    (0, (6, 1.4, 1.2, 1.4)),
    (0, (1.2, 1.2)),
    (0, (9, 2, 3, 2)),
)
SUFFIXES: dict[str, dict[str, Any]] = {  # and what keeps the date out of the file
    ".png": {},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
DPI = 150
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#444444",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "trunk",  # the same run gives the same file
    "svg.fonttype": "none",  # text stays text
    "pdf.fonttype": 42,
}


def with_unit(label: str, unit: str) -> str:
    """Return an axis' label: a quantity, and its unit in parentheses with dots between factors."""
    return f"{label} ({unit.replace(' ', '·')})" if unit else label


def line_style(index: int) -> dict[str, Any]:
    """Return colour and dashes of the i-th run; up to 8 x 5 runs look different."""
    return {
        "color": COLORS[index % len(COLORS)],
        "linestyle": DASHES[index % len(DASHES)],
    }


def save(figure: Figure, path: Path) -> None:
    """Write the picture in the format of the file's suffix; the same runs give the same bytes.

    Raises PlanError for a suffix other than png, svg or pdf.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise PlanError(f"{path}: a picture's name must end in one of {', '.join(SUFFIXES)}")
    picture = drawn(figure, suffix)  # matplotlib's writers do not say what went wrong with a file
    with atomic_write(path) as part:
        part.write_bytes(picture)


def drawn(figure: Figure, suffix: str) -> bytes:
    """Return the picture in the format of one of `SUFFIXES`."""
    picture = BytesIO()
    with rc_context(STYLE):
        figure.savefig(
            picture, format=suffix[1:], dpi=DPI, metadata=SUFFIXES[suffix], facecolor="white"
        )
    return picture.getvalue()
