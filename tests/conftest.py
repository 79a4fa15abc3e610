"""Every test knows, when its fixtures tidy up, whether it has failed."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from .failed import FAILED


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.stash[FAILED] = True
    return report
