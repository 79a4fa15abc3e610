"""A controller as C: pure Python functions translated to C99 that gives CPython's bits.

`translate.Program` translates functions, specialised by the types of example values; `controller` is a
registered law with its parameters, `files` what is written of it. docs/design.md has the subset of Python.
"""
