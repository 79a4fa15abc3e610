"""Gains from a model or from a search, and their margins."""
