"""docs/metrics.md: its examples of JSON follow the schemas."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from ros2_ws.src.trunk_experiments.test.documents import checked, strict

PAGE = (Path(__file__).parents[1] / "docs" / "metrics.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```json\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("text", EXAMPLES, ids=["metrics", "error"])
def test_an_example_is_a_document(text):
    checked(text, strict(text)["schema"].removeprefix("trunk/"))
