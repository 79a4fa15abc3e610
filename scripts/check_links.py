#!/usr/bin/env python3
"""Links and drives have the same bits wherever a run is made: see tests/links/check.py."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.links.check import main

main()
