"""Property tests try the same examples each time; HYPOTHESIS_PROFILE=default tries new ones.

No example has a time limit, and no test sets one: how long it takes is the machine's affair.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

_PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("default", _PATIENT)
settings.register_profile("same", _PATIENT, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
