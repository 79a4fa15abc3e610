"""Our own attacks on `trunk verify`, and honest runs that it must not accuse."""
