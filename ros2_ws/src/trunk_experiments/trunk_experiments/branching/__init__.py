"""Branches of recorded runs: the run as it was up to a time, and from then on with a change."""
