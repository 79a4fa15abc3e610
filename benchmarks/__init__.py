"""Speed as ratios, both sides measured in the same run: ``python -m benchmarks NAME``."""
