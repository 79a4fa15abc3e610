"""A run as a picture: shapes, their messages, and when a recording gets one. Pure."""
