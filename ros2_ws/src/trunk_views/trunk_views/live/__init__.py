"""A run in a browser: one process between the page and a running graph."""
