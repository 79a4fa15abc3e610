"""Whether a test has failed, for fixtures that tidy up after it."""

import pytest

FAILED = pytest.StashKey[bool]()
