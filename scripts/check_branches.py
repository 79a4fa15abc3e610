#!/usr/bin/env python3
"""Branches without a change are their parents: see tests/branches/check.py."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.branches.check import main

main()
