"""A recorded run: each part of the file is read once, for all that judge, measure, explain or show it."""
