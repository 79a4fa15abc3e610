"""A running graph, from outside."""
