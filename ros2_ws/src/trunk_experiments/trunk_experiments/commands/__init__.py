"""One module per verb of the ``trunk`` command, each with its click command as ``command``."""
