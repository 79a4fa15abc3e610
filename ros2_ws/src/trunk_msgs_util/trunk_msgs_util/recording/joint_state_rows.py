"""JointState messages packed in bulk: the bytes of `JointStateLayout.pack`, no Python work for each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..samples import JointSample
from ..units import LAST_STAMP_NS, NANOSECONDS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .joint_arrays import Floats, Integers
    from .joint_state_cdr import JointStateLayout


def packed(layout: JointStateLayout, stamp_ns: Integers, **quantities: Floats) -> NDArray[np.void]:
    """Return N messages of a layout, one element each.

    ``quantities`` are ``position``, ``velocity`` and ``effort`` [N, values], as many as the layout has.
    Raises ValueError for other shapes, and for stamps that no message can carry.
    """
    if (
        len(stamp_ns)
        and not -1 - LAST_STAMP_NS <= stamp_ns.min() <= stamp_ns.max() <= LAST_STAMP_NS
    ):
        raise ValueError(f"stamps beyond {LAST_STAMP_NS} ns cannot be packed")
    counts = layout.position, layout.velocity, layout.effort
    plain = layout.pack(JointSample(0, layout.name, *((0.0,) * count for count in counts)))
    whole = np.frombuffer(plain, f"V{layout.size}").repeat(len(stamp_ns))
    fields: NDArray[Any] = whole.view(layout.dtype)
    fields["sec"], fields["nanosec"] = np.divmod(stamp_ns, NANOSECONDS)
    for quantity, count in zip(("position", "velocity", "effort"), counts, strict=True):
        values = quantities.get(quantity, np.empty((len(stamp_ns), 0)))
        if values.shape != (len(stamp_ns), count):
            raise ValueError(
                f"{quantity} of shape {values.shape}: {count} values per message are needed"
            )
        fields[quantity] = values
    return whole
