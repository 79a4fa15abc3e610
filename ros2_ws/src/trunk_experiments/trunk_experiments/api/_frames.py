"""DataFrames of pandas, which is optional."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..errors import LibraryError
from ._units import UNITS

if TYPE_CHECKING:
    import pandas as pd


def frame(columns: Mapping[str, Any], index: str) -> pd.DataFrame:
    """Return columns as a DataFrame with one of them as its index, and their units in ``attrs["units"]``.

    Raises LibraryError if pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise LibraryError(
            "frame: pandas is not installed; install it with: pip install -r requirements/notebook.txt"
        ) from None
    table = pd.DataFrame(dict(columns)).set_index(index)
    table.attrs["units"] = {name: UNITS[name] for name in columns if name in UNITS}
    return table
