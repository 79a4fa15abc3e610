#!/usr/bin/env python3
"""Real nodes in a virtual world, seed by seed: see tests/seeds/check.py."""

from __future__ import annotations

import os
import sys
from pathlib import Path

if os.environ.get("PYTHONHASHSEED") != "0":  # the order of sets of names is part of a seed's trace
    os.environ["PYTHONHASHSEED"] = "0"
    os.execv(sys.executable, [sys.executable, *sys.argv])

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.seeds.check import main

main()
