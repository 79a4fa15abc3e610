"""Print what LLVM makes of a law's loop over lanes: lanes_code.py LAW. Compiled anew, and not kept."""

import sys

import numba
import numpy as np

from trunk_control.laws import law_named
from trunk_core.compiled import compiled
from trunk_runs.plan import make_plan
from trunk_studies.batch import block
from trunk_studies.batch.lanes import LANES, lanes_loop

name = sys.argv[1]
plan = make_plan("fig8", name)
run = block.regular_run(plan)
example = run.common._replace(
    **{part: block.shared(getattr(run.common, part)) for part in ("plant", "limits", "constants")}
)
loop = lanes_loop(law_named(name), plan.simulator.dynamics, example)
compiled(loop)  # registers what it calls
twin = numba.njit(loop, error_model="numpy", nogil=True, _nrt=False)
cells = np.zeros(LANES)
none = np.empty((0, 1, 1))
series = block.LaneSeries(np.zeros((10_001, 1, 1)), none, none)
twin.compile(tuple(numba.typeof(a) for a in (example, cells, series, np.empty((1, 64)), none)))
print("\n".join(twin.inspect_llvm().values()))
