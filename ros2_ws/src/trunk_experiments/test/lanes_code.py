"""Print what LLVM makes of a law's loop over lanes: lanes_code.py LAW. Compiled anew, and not kept."""

import sys

import numba
import numpy as np

from trunk_control.laws import law_named
from trunk_experiments.batch import block
from trunk_experiments.batch.lanes import LANES, lanes_loop
from trunk_experiments.plans.plan import make_plan
from trunk_msgs_util.compiled import compiled

name = sys.argv[1]
run = block.regular_run(make_plan("fig8", name))
example = run.common._replace(
    **{part: block.shared(getattr(run.common, part)) for part in ("plant", "limits", "constants")}
)
loop = lanes_loop(law_named(name), example)
compiled(loop)  # registers what it calls
twin = numba.njit(loop, error_model="numpy", nogil=True, _nrt=False)
cells = np.zeros(block.PARAMETERS * LANES)
none = np.empty((0, 1, 1))
series = block.LaneSeries(np.zeros((10_001, 1, 1)), none, none)
twin.compile(tuple(numba.typeof(a) for a in (example, cells, series, np.empty((1, 64)), none)))
print("\n".join(twin.inspect_llvm().values()))
