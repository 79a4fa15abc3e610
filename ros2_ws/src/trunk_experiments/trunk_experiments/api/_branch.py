"""What if: a recorded run, with a change from one of its states on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from ..errors import PlanError
from ._paths import AnyPath
from ._run import Run
from ._simulate import recorded, run_of
from ._values import mapping_of, plain


def branch(
    run: Run | AnyPath,
    at: float,
    *,
    overrides: Mapping[str, Any] = MappingProxyType({}),
    controller: str = "",
    pushes: Sequence[str] = (),
    duration: float | None = None,
    output: AnyPath | None = None,
    overwrite: bool = False,
) -> Run:
    """Return a run that is the recorded one up to ``at`` s, and from then on simulated with a change.

    ``overrides``: values from then on, by ``"NODE.PARAM"``, in SI units and radians.
    ``controller``: who acts from then on; empty: as recorded.
    ``pushes``: pulses, such as ``"60Nm:0.1s"`` or ``"hip_effort=300N:50ms@2.5s"``.
    ``duration``: when it ends, in s; None: as planned. ``output``, ``overwrite``: as for `simulate`.

    Raises PlanError for a change that is not possible, RecordingError for a run that does not verify up to
    ``at``, and DivergedError.
    """
    from ..branching.branch import Branch
    from ..branching.change import branched
    from ..branching.record import record_branch
    from ..branching.resume import resumed, state_at

    if isinstance(pushes, str):
        raise PlanError(f"pushes {pushes!r}: a list is needed, such as ['60Nm:0.1s']")
    values = mapping_of(overrides, "overrides", "{'NODE.PARAM': value}")
    settings = tuple(f"{name}={plain(value)}" for name, value in values.items())
    change = Branch(float(at), settings, controller, tuple(pushes))
    parent = run_of(run)._recorded
    start = resumed(parent, state_at(parent, change.at, bool(controller)))
    made = branched(parent, start, change, duration)
    return recorded(
        lambda path: record_branch(parent, change, made, path, overwrite),
        "branch.mcap",
        output,
        overwrite,
        [parent.path],
    )
