"""Judges past runs: recomputes, compares, explains and repeats them."""
