"""A controller as C: pure Python functions translated to C99 that gives CPython's bits.

`trunk_core.c.translate.Program` translates functions, specialised by the types of example values; `library`
is a registered law with its parameters, and what is written of it. docs/design.md has the subset of Python.
"""
