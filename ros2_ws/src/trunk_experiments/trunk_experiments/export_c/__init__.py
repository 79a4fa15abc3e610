"""A controller as C: pure Python functions translated to C99 that gives CPython's bits.

`translate.Program` translates functions, specialised by the types of example values; `controller` exports a
registered law with its parameters. docs/design.md says which Python the translator takes.
"""
