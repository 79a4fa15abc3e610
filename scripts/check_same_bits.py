#!/usr/bin/env python3
"""A plan has the same bits by every path: see tests/same_bits/check.py."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.same_bits.check import main

main()
