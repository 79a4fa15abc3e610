"""Reproduces the paper's figures, judges its claims and shows its misprints."""
