"""Fixtures that tidy up can see whether their test failed; small recordings to read."""

from collections.abc import Generator
from pathlib import Path

import pytest
from ros2_ws.src.trunk_recording.test.conftest import RunFile

from .failed import FAILED


@pytest.fixture
def run_file(tmp_path: Path) -> RunFile:
    return RunFile(tmp_path)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed:
        item.stash[FAILED] = True
    return report
