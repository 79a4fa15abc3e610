"""Access to a running graph from outside."""
