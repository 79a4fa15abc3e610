"""A plant as frames, a run as shapes, their messages, and when a recording gets one. Pure."""
