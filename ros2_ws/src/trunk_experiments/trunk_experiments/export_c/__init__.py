"""A controller as C: pure Python functions translated to C99 that gives CPython's bits.

`translate.Program` translates functions, specialised by the types of example values; `exported_controller`
is a registered law with its parameters, `library` what is written of it. docs/design.md has the subset of
Python.
"""
