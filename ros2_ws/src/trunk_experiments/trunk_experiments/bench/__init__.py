"""Speed, as ratios in one run, and what a long run must show."""
