"""Benchmarks as ratios measured in one run, and the checks of a long run."""
