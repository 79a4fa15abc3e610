"""What callers give (paths, values, names), and how results are shown (units, tables, data frames)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from trunk_control.laws import law_named
from trunk_core.errors import LibraryError, PlanError, did_you_mean
from trunk_core.parameters.parameter_files import Layer, Section
from trunk_evidence.run_metrics import QUANTITIES
from trunk_evidence.run_table import DISTURBANCE, TABLE_UNITS
from trunk_evidence.run_table import UNITS as OF_TERMS
from trunk_runs.nodes import CONTROLLERS, NODES, Parameter, parameters_of
from trunk_runs.scenario import SCENARIOS, shipped_files
from trunk_sim.plants.trunk import PLANT

if TYPE_CHECKING:
    import pandas as pd


AnyPath = str | os.PathLike[str]


def path_of(value: AnyPath, subject: str) -> Path:
    """Return a path. Raises PlanError, naming what it is for, if the value is not a path."""
    if not isinstance(value, str | os.PathLike) or "\0" in str(value):
        raise PlanError(f"{subject} {value!r} is not a path: give a string or a pathlib.Path")
    return Path(value)


def output_path(
    value: AnyPath, suffixes: Sequence[str], overwrite: bool, inputs: Iterable[Path] = ()
) -> Path:
    """Return the path of a file that may be written.

    Raises PlanError for a file that exists, unless ``overwrite``, for one of the ``inputs``, for any other
    suffix and for a folder that does not exist.
    """
    from ..console.options import check_output

    path = path_of(value, "output")
    with writing(path):
        if path.exists() and not path.is_dir() and not overwrite:
            raise PlanError(f"output {path}: it exists: give another name, or overwrite=True")
        return check_output(path, suffixes, overwrite, inputs, "output")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError from writing a file into a PlanError that names the file."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise PlanError(f"output {path}: {reason}: give another place") from None


COLUMNS = tuple(TABLE_UNITS)  # of a run, in order

UNITS: Mapping[str, str] = MappingProxyType(
    {
        **TABLE_UNITS,
        **OF_TERMS,
        **dict(zip(DISTURBANCE, PLANT.channel_units.values(), strict=True)),
        **{name: quantity.unit for name, quantity in QUANTITIES.items()},
        "diverged_at_s": "s",
    }
)
"""The unit of each column and metric, by name; empty: no unit."""


Inner = TypeVar("Inner")


def keyed(nested: Mapping[str, Mapping[str, Inner]]) -> Mapping[str, Mapping[str, Inner]]:
    """Return nested mappings that cannot be changed."""
    return MappingProxyType({key: MappingProxyType(dict(inner)) for key, inner in nested.items()})


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


def plain(value: Any) -> Any:
    """Return a NumPy value as one of Python's own types; a sequence becomes a list."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [plain(item) for item in value]
    return value


def layers_of(overrides: Mapping[str, object], acting: Sequence[str]) -> list[Layer]:
    """Return a layer for each override; ``acting``: the controllers of the run.

    Raises PlanError for a name that is not ``NODE.PARAM``, and for a node that is not in the run.
    """
    layers = []
    nodes = [name for name in NODES if name not in CONTROLLERS or name in acting]
    for target, value in mapping_of(overrides, "overrides", "{'NODE.PARAM': value}").items():
        node, dot, name = str(target).partition(".")
        if not dot or not name or node not in NODES:
            raise PlanError(
                f"overrides: {target!r}: NODE.PARAM is needed, NODE one of {', '.join(nodes)}"
                f"{did_you_mean(node, nodes) if dot else ''}"
            )
        if node not in nodes:
            raise PlanError(
                f"overrides: {target!r}: {node} is not in this run: give one of {', '.join(nodes)}"
            )
        layers.append(Layer(f"overrides: {target}", (Section(node, {name: plain(value)}),)))
    return layers


def mapping_of(value: Any, subject: str, such_as: str) -> Mapping[str, Any]:
    """Return a mapping. Raises PlanError, naming what it is for, if the value is not one."""
    if not isinstance(value, Mapping):
        raise PlanError(f"{subject} {value!r}: a mapping is needed, such as {such_as}")
    return value


def names_of(value: AnyPath | Sequence[AnyPath], subject: str) -> list[str]:
    """Return one or more names or paths as a list of strings. Raises PlanError for anything else."""
    values: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
    return [str(path_of(item, subject)) for item in values]


def number_of(value: Any, subject: str) -> Any:
    """Return a number as Python's own, None and strings as they are. Raises PlanError for anything else."""
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int | float | str | None):
        raise PlanError(f"{subject} {value!r}: a number is needed")
    return value


def scenarios() -> dict[str, str]:
    """Return the shipped scenarios by name, with a line about each."""
    return {name: text for name, text in _shipped().items() if name in SCENARIOS}


def parameter_files() -> dict[str, str]:
    """Return the shipped parameter files by name, with a line about each: gains, tables, profiles."""
    return {name: text for name, text in _shipped().items() if name not in SCENARIOS}


def controllers() -> dict[str, str]:
    """Return the label of each controller, by the name of its node."""
    return {name: law_named(name).label for name in CONTROLLERS}


def studies() -> dict[str, str]:
    """Return the shipped studies by name, with a line about each."""
    from trunk_studies.study import shipped_studies

    return {name: _first_line(path) for name, path in shipped_studies().items()}


def parameters(node: str) -> dict[str, Parameter]:
    """Return by name what ``simulator``, ``disturbance``, ``recorder`` or a controller declares, for `plan`.

    Raises PlanError for any other name.
    """
    if not isinstance(node, str) or node not in NODES:
        raise PlanError(
            f"no node {node!r}: give one of {', '.join(NODES)}{did_you_mean(str(node), NODES)}"
        )
    return parameters_of(node)


def _shipped() -> dict[str, str]:
    return {name: _first_line(path) for name, path in shipped_files().items()}


def _first_line(path: Path) -> str:
    return path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
