"""What a recording says of its run: what counts of it, metrics, verdict, differences, explanations, branches.

Each part of a file is read once, for all that judge, measure, explain or show it.
"""
