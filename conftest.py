"""Property tests try the same examples each time; HYPOTHESIS_PROFILE=default tries new ones."""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None)  # load must fail no test
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))
