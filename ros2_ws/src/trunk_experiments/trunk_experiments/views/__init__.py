"""Looking at runs: plots, reports, comparisons, extracts, markers."""
