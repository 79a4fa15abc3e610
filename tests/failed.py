"""Whether a test has failed, for fixtures that tidy up after it."""

from __future__ import annotations

import pytest

FAILED = pytest.StashKey[bool]()
