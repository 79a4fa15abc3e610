#!/usr/bin/env python3
"""Bugs planted one by one are found by the virtual world: see tests/seeds/planted.py."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.seeds.planted import main

main()
