#!/usr/bin/env python3
"""Mutants of the nodes, one by one, are found by the virtual world: see tests/seeds/mutants.py."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.seeds.mutants import main

main()
