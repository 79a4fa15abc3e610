"""What all verbs share at a terminal: options, tables, progress, opening a recording."""
