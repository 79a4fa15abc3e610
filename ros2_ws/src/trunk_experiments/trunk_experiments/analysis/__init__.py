"""Numbers of one run: the table of its signals, and the metrics."""
